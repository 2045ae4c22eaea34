import ast
from pathlib import Path

from wearscope.jobs import study_files as sources


def test_imports_are_followed_and_only_they(tmp_path):
    script = tmp_path / "script.py"
    script.write_text("import numpy\nfrom wearscope.designs.kinds import make_design\n")
    names = {
        file.relative_to(sources.ROOT).as_posix() for file in sources.find_sources(script) if file != script
    }
    assert {"designs/kinds.py", "designs/factors.py", "designs/__init__.py"} <= names
    assert {"errors.py", "__init__.py"} <= names
    assert not any(name.startswith(("detectors/", "surrogates/")) for name in names)


def test_modules_named_as_attributes_and_inside_functions_are_found(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "def f():\n    from wearscope.designs import bases\n    import wearscope.storage.tables as t\n"
    )
    names = {file.name for file in sources.find_sources(script)}
    assert {"bases.py", "tables.py", "script.py"} <= names


def test_imports_in_every_kind_of_block_are_found(tmp_path):
    blocks = {
        "limits": "try:\n    {0}\nexcept OSError:\n    pass",
        "plugins": "try:\n    pass\nexcept OSError:\n    {0}",
        "errors": "try:\n    pass\nfinally:\n    {0}",
        "home": "for k in ():\n    pass\nelse:\n    {0}",
        "processes": "with open('x'):\n    if 0:\n        pass\n    elif 1:\n        {0}",
        "supervision": "class A:\n async def f(self):\n  match 1:\n   case 1:\n    {0}",
    }
    for name, block in blocks.items():
        script = tmp_path / f"{name}_script.py"
        script.write_text(block.format(f"import wearscope.{name}") + "\n(lambda: 0)()\n")
        assert sources.ROOT / f"{name}.py" in sources.find_sources(script), name


def test_imports_for_type_checking_do_not_count(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from wearscope.designs import bases\n"
        "else:\n    from wearscope import errors\n"
    )
    names = {file.name for file in sources.find_sources(script)}
    assert "errors.py" in names and "bases.py" not in names


def test_plugin_files():
    assert sources.plugin_file("residual_energy", "detectors").is_file()
    assert sources.plugin_file("my/own.py", "detectors").as_posix() == "my/own.py"


def test_every_file_s_imports_are_those_that_python_sees():
    """Found by pattern, against the syntax tree: an import that is overlooked would keep an old result."""
    files = [*sources.ROOT.rglob("*.py"), *Path("workflow/scripts").glob("*.py")]
    assert len(files) > 300
    for file in files:
        tree = ast.parse(file.read_text(encoding="utf-8"))
        checked = [n for n in ast.walk(tree) if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n.test)]
        hidden = {id(n) for branch in checked for part in branch.body for n in ast.walk(part)}
        names = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import) and id(node) not in hidden:
                names.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module and id(node) not in hidden:
                names.update(f"{node.module}.{alias.name}" for alias in node.names)
        seen = {Path(one) for name in names for one in sources._module_files(name)}
        assert set(sources._imports(file)) == seen, file
