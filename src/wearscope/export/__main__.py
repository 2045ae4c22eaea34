"""``python -m wearscope.export MODEL --out DIR``."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from wearscope.errors import InputError
from wearscope.export.run import FILES, export_model, read_verdict_of
from wearscope.robots.model import load_model
from wearscope.robots.model_file import find_model


def main(arguments: Sequence[str] | None = None) -> int:
    """Export a model and say what the formats cannot hold."""
    parser = argparse.ArgumentParser(
        prog="python -m wearscope.export",
        description="Write a model, e.g. model_after.yaml, as URDF, MJCF and a table of parameters.",
    )
    parser.add_argument("model", help="model file, its folder, or the name of one in config/robots")
    parser.add_argument("--out", type=Path, required=True, help=f"folder that gets {', '.join(FILES)}")
    parser.add_argument("--temperature", type=float, default=50.0, help="of the friction [deg C]")
    parser.add_argument("--allow-code", action="store_true", help="let the model name effects by .py files")
    given = parser.parse_args(arguments)
    try:
        path = find_model(given.model)
        model = load_model(path, strict=False, allow_code=given.allow_code)
        summary = export_model(model, given.out, read_verdict_of(path), given.temperature)
    except InputError as error:
        print(error, file=sys.stderr)
        return 1
    for name in FILES:
        print(given.out / name)
    for one in summary["left"]:
        print(f"not in {one['format']}: {one['effect']} at {one['joint']}: {one['reason']}")
    for joint, one in (summary["mujoco"] or {}).items():
        print(
            f"{joint}: of {one['torque_rms']:.4g} {one['unit']} RMS MuJoCo differs by "
            f"{one['difference_without_coulomb']:.1g} without Coulomb friction, by "
            f"{one['difference_where_moving']:.2g} with it where the joint moves; what MJCF cannot "
            "hold makes "
            f"{one['not_held_where_moving']:.3g}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
