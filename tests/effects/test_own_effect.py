"""A user's own effect is one file, named by path: loaded, checked, evaluated and simulated."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from calls import call_python
from own_effects import HOSE, PRESSURE
from urdf_texts import Joint, describe_robot

from wearscope.cycles.base import Reference
from wearscope.effects.base import Plant, load_effect
from wearscope.errors import InputError
from wearscope.robots.model import load_model, save_model
from wearscope.simulation.plant import build_plant
from wearscope.simulation.study import trace_forward

BODY = "from wearscope.effects.base import BodyEffect\n"
LOAD = (
    "from wearscope.effects.base import load_effect\n"
    "import numpy as np\n"
    "effect = load_effect({path!r})\n"
    "print(effect.name, sum(effect.row.stats.cache_hits.values()))\n"
)


@pytest.fixture
def write(tmp_path):
    def make(text=HOSE, name="hose.py"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
        return path

    return make


def load_in_fresh_process(path) -> str:
    done = call_python("-c", LOAD.format(path=str(path)))
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_every_process_loads_it_and_later_ones_compile_nothing(write):
    path = write()
    assert [load_in_fresh_process(path) for _ in range(3)] == ["hose_drag 0", "hose_drag 1", "hose_drag 1"]


def test_a_folder_that_was_moved_with_what_was_compiled_still_loads(write, tmp_path):
    path = write(name="first/hose.py")
    load_in_fresh_process(path)
    moved = shutil.move(str(path.parent), str(tmp_path / "second"))
    assert [load_in_fresh_process(f"{moved}/hose.py") for _ in range(2)] == ["hose_drag 0", "hose_drag 1"]


def test_the_same_path_gives_the_same_object_until_the_file_changes(write, tmp_path, monkeypatch):
    path = write()
    effect = load_effect(str(path))
    assert load_effect(str(path)) is effect
    assert load_effect("hose.py", folder=tmp_path) is effect
    monkeypatch.chdir(tmp_path)
    assert load_effect("./hose.py") is effect
    assert effect.reference == effect.label == str(path)
    write(HOSE.replace("hose_drag", "cable_drag"))
    assert load_effect(str(path)).name == "cable_drag"


def test_files_of_one_name_in_two_folders_are_two_effects(write):
    one, two = write(name="x/own.py"), write(HOSE.replace("hose_drag", "cable_drag"), "y/own.py")
    assert [load_effect(str(path)).name for path in (one, two)] == ["hose_drag", "cable_drag"]


def test_a_class_of_its_own_gives_a_rule_anew(write):
    own = "class Bump(Effect):\n    repeatable = True\n\n\nEFFECT = Bump("
    effect = load_effect(str(write(HOSE.replace("EFFECT = Effect(", own))))
    assert effect.repeatable and not load_effect("stribeck").repeatable
    assert effect.complexity([0]) == 1 and effect.label == str(effect.reference)


def test_code_that_a_data_set_names_runs_only_where_it_is_allowed(write, tmp_path, refuses):
    ran = tmp_path / "ran"
    path = write(f"open({str(ran)!r}, 'w').close()\n{HOSE}")
    refuses(load_effect, str(path), allow_code=False)
    assert not ran.exists()
    load_effect(str(path), allow_code=True)
    assert ran.exists()
    assert load_effect("coulomb", allow_code=False).name == "coulomb"


def test_it_is_evaluated_and_simulated_by_the_same_row(write, signals):
    effect = load_effect(str(write()))
    torque = effect.torque(signals, 1, {"level": 3.0})
    expected = 3.0 * np.sin(2.0 * signals.q[:, 1]) * signals.sign[:, 1]
    np.testing.assert_allclose(torque, expected, rtol=1e-12)
    plant = Plant(3)
    effect.install(plant, 1, {"level": 3.0})
    (term,) = plant.terms
    assert (term.row, term.joint, term.coefficients.tolist()) == (effect.row, 1, [3.0])


def test_further_channels_are_signals_of_an_own_effect(write, signals, refuses):
    effect = load_effect(str(write(PRESSURE)))
    pressure = 50.0 + np.sin(signals.t)
    measured = replace(signals, channels={"pressure": pressure})
    torque = effect.torque(measured, 2, {"area": 0.1})
    np.testing.assert_allclose(torque, 0.1 * pressure * signals.q[:, 2])
    shapes = np.zeros((2, 0))
    assert effect.stack(measured, 2, shapes).shape == (len(signals.t), 2)
    refuses(effect.torque, signals, 2, {"area": 0.1})


def test_a_row_stands_for_signals_without_channels(write, signals):
    both = HOSE.replace("row=_row,", "row=_row, regressors=lambda s, j, shape: 5.0 * s.q[:, [j]],")
    effect = load_effect(str(write(both)))
    by_row = np.sin(2.0 * signals.q[:, 1]) * signals.sign[:, 1]
    np.testing.assert_allclose(effect.torque(signals, 1, {"level": 1.0}), by_row)
    measured = replace(signals, channels={"pressure": signals.t})
    np.testing.assert_allclose(effect.torque(measured, 1, {"level": 1.0}), 5.0 * signals.q[:, 1])


def test_an_effect_without_a_row_is_not_simulated(write, refuses):
    effect = load_effect(str(write(PRESSURE)))
    refuses(effect.install, Plant(2), 0, {"area": 0.1})


def test_regressors_of_a_wrong_shape_are_refused(write, signals, refuses):
    effect = load_effect(str(write(PRESSURE.replace("[:, None] * s.q[:, [j]]", ""))))
    measured = replace(signals, channels={"pressure": signals.t})
    refuses(effect.columns, measured, 0, np.zeros(0))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("EFFECT = ", "OTHER = ", r"defines no EFFECT"),
        ("EFFECT = Effect(", "EFFECT = dict(", r"EFFECT is a dict"),
        ("import numpy as np", "import numpy as np\nraise OSError('no disk')", r"raised OSError: no disk"),
        ("def _row(", "def _row(]", r"raised SyntaxError"),
        ('"hose_drag"', '"hose drag"', r"EFFECT.name is 'hose drag'"),
        ('"hose_drag"', '"coulomb"', r"'coulomb' is taken by the vocabulary"),
        ("    row=_row,\n", "", r"neither 'row' nor 'regressors'"),
        ("@compile_row\n", "", r"row is not compiled; put @compile_row"),
        ('(Parameter("level", "{torque}"),)', "()", r"coefficients is empty"),
        ('(Parameter("level", "{torque}"),)', '("level",)', r"coefficients is no tuple of Parameter"),
        ('"level", "{torque}"', '"k", "{torque}"', r"two parameters are called 'k'"),
        ('"level", "{torque}"', '"the level", "{torque}"', r"a parameter is called 'the level'"),
        ('"level", "{torque}"', '"level", "{force}"', r"unit '{force}' of parameter 'level'"),
        ('"{torque}")', '"{torque}", lower=2.0, upper=1.0)', r"nothing between 2.0 and 1.0"),
        ("default=2.0", "default=2.0, upper=1.0", r"default 2.0 of parameter 'k' lies outside"),
        ("row=_row,", 'row=_row, variants=(("levle",),),', r"variants holds \('levle',\)"),
        ("row=_row,", 'row=_row, variants=("level",),', r"variants holds 'level'"),
        ("row=_row,", "row=_row, variants=((),),", r"variants holds \(\)"),
        ("row=_row,", 'row=_row, extensions=("k",),', r"extensions holds 'k'"),
        ("row=_row,", 'row=_row, parents="coulomb",', r"parents is no tuple of text"),
        ('("q_{joint}", "sign_qd_{joint}")', "()", r"depends_on is empty"),
        ('"sign_qd_{joint}"', '"qd_{axis}"', r"other braces than {joint}"),
        ("out[0] = np", "x = np", r"leaves a regressor or a state unwritten"),
        ("out[0] = np", "out[1] = out[0] = np", r"writes beyond the 1 values of 'out'"),
        ("out[0] = np", "next_state[0] = out[0] = np", r"writes beyond .* the 0 of 'next_state'"),
        ("row=_row,", "row=_row, n_states=1,", r"leaves a regressor or a state unwritten"),
        ("EFFECT = Effect(", f"{BODY}EFFECT = BodyEffect(spread=False, ", r"per_robot needs 'spread'"),
    ],
)
def test_what_breaks_a_rule_is_told_in_one_sentence(write, old, new, said):
    assert old in HOSE
    path = write(HOSE.replace(old, new, 1))
    with pytest.raises(InputError, match=said) as told:
        load_effect(str(path))
    message = str(told.value)
    assert message.startswith(str(path)) and message.endswith(".") and "\n" not in message


def test_variants_and_extensions_are_tuples_of_coefficients(write):
    two = HOSE.replace('"{torque}"),)', '"{torque}"), Parameter("slope", "{torque}"))')
    two = two.replace("    out[0] =", "    out[1] = q[j]\n    out[0] =")
    fields = 'variants=(("level",),), extensions=(("level", "slope"), ("slope",)),'
    effect = load_effect(str(write(two.replace("row=_row,", f"row=_row, {fields}"))))
    assert [list(one) for one in effect.subsets()] == [[0]]
    assert effect.extensions == (("level", "slope"), ("slope",))


def test_a_file_that_is_not_there_is_told(tmp_path, refuses):
    refuses(load_effect, "nothing.py", folder=tmp_path)


URDF = describe_robot(Joint("turn", "0 0 1", 5, "0.2 0 0", "0.1 0.2 0.2"))


def test_a_robot_s_model_names_it_from_its_own_folder_and_simulates_it(write, tmp_path, monkeypatch, refuses):
    write(name="robots/effects.py")
    (tmp_path / "robots" / "arm.urdf").write_text(URDF)
    entry = "{joint: turn, effect: effects.py, parameters: {level: 3.0, k: 1.5}}"
    file = tmp_path / "robots" / "model.yaml"
    file.write_text(f"name: arm\nurdf: arm.urdf\njoints: [turn]\neffects: [{entry}]\n")
    monkeypatch.chdir("/")
    refuses(load_model, file)
    model = load_model(file, allow_code=True)
    (term,) = build_plant(model).terms
    assert (term.coefficients.tolist(), term.shape.tolist()) == ([3.0], [1.5])
    again = tmp_path / "robots" / "copies" / "model.yaml"
    again.parent.mkdir()
    save_model(model, again)
    assert "effect: ../effects.py" in again.read_text()
    assert load_model(again, allow_code=True).effects == model.effects

    plain = model.replace(effects=[])
    t = np.arange(0.0, 1.0, 5e-4)
    omega, angle = 2.0 * np.pi * 1.2, 2.0 * np.pi * 1.2 * t[:, None]
    motion = Reference(t, np.sin(angle), omega * np.cos(angle), -(omega**2) * np.sin(angle))
    trace, dt = trace_forward(model, motion, plain)
    q, v = trace.q[:-1, 0], trace.v[:, 0]
    steps = slice(200, -200)
    acceleration = np.gradient(trace.v, dt, axis=0)
    rigid = model.rigid_body().inverse_dynamics(trace.q[:-1], trace.v, acceleration)
    added = trace.torque[:, 0] - rigid[:, 0]
    expected = 3.0 * np.sin(1.5 * q) * np.sign(v)
    moving = np.abs(v[steps]) > 0.5
    np.testing.assert_allclose(added[steps][moving], expected[steps][moving], atol=0.05)
