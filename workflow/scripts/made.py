"""What a page says of the code that made it, as several scripts tell it."""

from wearscope.storage.provenance import describe_provenance, list_platform_files


def tell_provenance():
    """Versions, commit and digest, by what they are called."""
    made = describe_provenance(list_platform_files())
    return {
        "wearscope": made["code"]["wearscope"],
        "commit": made["code"]["commit"],
        "sources (SHA-256)": made["code"]["sha256"],
        "Python": made["python"],
        "packages": made["packages"],
    }
