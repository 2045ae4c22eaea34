"""PyBullet's banner is dropped, errors are not."""

from calls import call_python


def run(code):
    done = call_python("-c", code)
    return done.returncode, done.stdout, done.stderr


def test_the_banner_is_printed_without_and_not_with_the_module():
    assert "pybullet build time" in "".join(run("import pybullet")[1:])
    assert run("from wearscope.simulation import world; print(world.pybullet.DIRECT)") == (0, "2\n", "")


def test_everything_else_is_passed_on():
    code, out, error = run(
        "import os, sys\n"
        "from wearscope.simulation.world import drop_banner\n"
        "with drop_banner():\n"
        "    os.write(2, b'pybullet build time: now\\nlow on memory\\n')\n"
        "    print('a warning', file=sys.stderr)\n"
        "    print('a result', flush=True)\n"
        "    raise ImportError('no such symbol')\n"
    )
    assert code == 1 and out == "a result\n"
    assert error.startswith("low on memory\na warning\nTraceback")
    assert "ImportError: no such symbol" in error and "build time" not in error


def test_a_process_without_standard_error_imports_it_too():
    code = "import os; os.close(2); from wearscope.simulation import world; print('ok')"
    assert run(code)[:2] == (0, "ok\n")
