"""The ``dataset.yaml`` of data sets that tests make, and changes of YAML files that they copy."""

from contextlib import contextmanager

import yaml

DECLARED = ("rigid_body", "rotor_inertia", "coulomb", "viscous")


@contextmanager
def changed_fields(file):
    """Content of a YAML file, written back as the body leaves it."""
    fields = yaml.safe_load(file.read_text())
    yield fields
    file.write_text(yaml.safe_dump(fields))


def write_fields(folder, joints, rate, runs, declared=DECLARED, robot=None, **more):
    """Describe the data set in a folder, whose robot is in ``robot.urdf``; gives the folder back."""
    robot = {"urdf": "robot.urdf", "joints": list(joints), **(robot or {})}
    fields = {
        "name": "duo",
        "robot": robot,
        "sample_rate": rate,
        "declared_effects": list(declared),
        "runs": runs,
    }
    (folder / "dataset.yaml").write_text(yaml.safe_dump(fields | more))
    return folder
