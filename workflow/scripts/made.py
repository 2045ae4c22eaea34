"""Describes, for the reports, the code that made the results; shared by several scripts."""

from wearscope.storage.provenance import describe_provenance, list_platform_files


def tell_provenance():
    """Return versions, commit and digest, by their labels on a page."""
    made = describe_provenance(list_platform_files())
    return {
        "wearscope": made["code"]["wearscope"],
        "commit": made["code"]["commit"],
        "sources (SHA-256)": made["code"]["sha256"],
        "Python": made["python"],
        "packages": made["packages"],
    }
