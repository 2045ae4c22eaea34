# ruff: noqa: E501
"""Files that someone careless, or with ill will, could hand over, and the commands that read them.

`make_case` makes the n-th input of a subject: a sound folder of which a file is spoiled, and the command line
that reads it. `Runner` runs command lines, each in a process of its own with bounds on time and memory:

    with Runner() as run:
        folder.mkdir()
        case = make_case("check dataset", 7, folder)
        print(case.told, run(case.arguments, folder))
"""

import io
import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tarfile
import time
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import yaml

ROOT = Path(__file__).parents[1]
#: Bounds of one command: processor and wall time [s], memory [bytes].
SECONDS, WAITED, MEMORY = 10, 120, 2 << 30
#: What spoiled files would make if anything in them ran.
RAN = "ran"

LINK = (
    '<link name="{0}"><inertial><origin xyz="0 0.1 0.2"/><mass value="{1}"/><inertia ixx="0.2" iyy="0.2" izz="0.1"'
    ' ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="0 0 0.3"/>'
    '<axis xyz="0 {3} 1"/><limit lower="-2" upper="2" effort="80" velocity="3"/></joint>'
)
URDF = (
    '<robot name="duo"><link name="base"/>'
    + LINK.format("one", 4)
    + LINK.format("two", 2)
    + JOINT.format("j1", "base", "one", 0)
    + JOINT.format("j2", "one", "two", 1)
    + "</robot>"
)
FIELDS = {
    "name": "duo", "description": "d", "robot": {
        "urdf": "robot.urdf", "joints": ["j1", "j2"], "gravity": [0, 0, -9.81], "gear_ratio": [50, 80],
        "torque_limit": [80, 80], "rotor_inertia": [0.1, 0.1], "inertials": "approximate",
    },
    "sample_rate": 100.0, "units": {"q": "rad", "tau": "N m"},
    "declared_effects": ["rigid_body", "coulomb", "viscous"], "torque": "motor", "turned": [], "accept": ["unrelated tau"],
    "channels": {"fan": "1"}, "reference": ["a"],
    "runs": [
        {"file": "a.csv", "use": "train", "session": "a", "payload": {"mass": 1.0, "com": [0, 0, 0.1]}},
        {"file": "b.parquet", "use": "test", "session": "b"},
    ],
}  # fmt: skip
SERVO = {"law": "current", "kt": 1.2}


def make_table(seed: int, rows: int = 1000) -> pd.DataFrame:
    """A recording of both joints."""
    t = np.arange(rows) / 100.0
    noise = np.random.default_rng(seed).normal(size=(4, rows))
    columns = {"t": t, "fan": t}
    for k in (1, 2):
        columns[f"q_j{k}"] = np.sin((2 + k + seed) * t)
        columns[f"tau_j{k}"] = columns[f"current_j{k}"] = 5.0 * np.cos(3 * k * t) + noise[k]
    return pd.DataFrame(columns)


# ------------------------------------------------------------------------------------------- spoiled content

ODD = [
    None, True, False, "", " ", "..", "../../etc/passwd", "/etc/passwd", "/dev/zero", "-rf", "--help", "~", "con",
    "a\x00b", "a\nb\rc", "\x1b[2J\x1b]0;x\x07", "\u202egpj.exe", "\ufeff", "\u2028", "{x}", "{{x}}", "$(touch ran)",
    "`touch ran`", "%s%n", "é" * 400, "x" * 100_000, "\U0001f600", "nan", "1e400", "0x1F", "1_000", "12:30:45",
    -1, 0, 2, 1e308, -1e308, 1e-320, 1e31, float("nan"), float("inf"), float("-inf"), 2**63, -(2**70), 10**39,
    [], {}, [[]], [None], {"": ""}, [1, "a", None], ["j1"] * 5, {"a": {"b": {"c": 1}}}, ["x"] * 3000,
    list(range(20_000)), "evil.py", ["evil.py"], {"use": "evil.py"}, {"allow_code": True},
]  # fmt: skip
#: Texts in place of a value that only YAML knows.
WRITTEN = [
    "&a [*a]", "*none", "!!python/object/apply:os.system ['touch ran']", "!!python/name:os.system ''",
    "!!timestamp x", "!!bool maybe", "!!binary ab", "!!set {a}", "!!omap [a: 1]", "!!float x", "!!int ''", "!x y",
    "? [a]\n: b", "{<<: {a: 1}, <<: {b: 2}}", "{[1]: 2}", "{a: 1, a: 2}", "2024-13-45", "2024-01-01 25:00:00",
    "0o777777", ".nan", "-.inf", "1e999", "1" * 39, "9" * 5000, "0b1", "[" * 60 + "]" * 60, "[" * 3000, "{a: " * 50,
    "'", '"', "|\n", ">-\n  x", "@x", "%x", "\t", "=", "<<", "&b {x: &c [1, *b]}", "~ ~",
]  # fmt: skip


def bomb() -> str:
    """Lists of lists of aliases."""
    rows = ["a0: &a0 [x, x, x, x]"]
    rows += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 10)]
    return "\n".join(rows) + "\n"


def merge_bomb() -> str:
    """Mappings that merge mappings."""
    rows = ["a0: &a0 {x: 1}"]
    rows += [f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}" for k in range(1, 10)]
    return "\n".join(rows) + "\n"


def list_places(node, place=()):
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in children:
        yield (*place, key)
        yield from list_places(child, (*place, key))


def put(tree, place, value):
    for key in place[:-1]:
        tree = tree[key]
    tree[place[-1]] = value


def spoil_tree(tree, draw: random.Random, dump: Callable[[object], str], written: bool) -> tuple[str, str]:
    """Text of a tree of which one or two nodes are replaced, removed, doubled or renamed, and what was done."""
    tree, told, raw = json.loads(json.dumps(tree)), [], {}
    for _ in range(draw.choice([1, 1, 2])):
        place = draw.choice(list(list_places(tree)))
        inner = tree
        for key in place[:-1]:
            inner = inner[key]
        what = draw.choice(["replace"] * 6 + ["remove", "rename", "write", "write", "more"])
        if what == "write" and written:
            mark = f"mark{len(raw)}here"
            raw[mark] = draw.choice(WRITTEN)
            put(tree, place, mark)
        elif what == "remove":
            del inner[place[-1]]
        elif what == "rename" and isinstance(inner, dict):
            inner[str(draw.choice([place[-1] + "s", "", "__class__", "é", "a\nb", "__use_yte__"]))] = (
                inner.pop(place[-1])
            )
        elif what == "more" and isinstance(inner, list):
            inner.extend([inner[0]] * draw.choice([1, 50, 5000]))
        else:
            put(tree, place, draw.choice(ODD))
        told.append(f"{what} {'.'.join(map(str, place))}")
    text = dump(tree)
    for mark, fragment in raw.items():
        text = text.replace(mark, fragment)
        told.append(f"as {fragment[:30]!r}")
    return text, "; ".join(told)


def spoil_bytes(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    """Bytes of a file, spoiled as any file may be."""
    at = draw.randrange(len(content) + 1)
    junk = draw.choice([b"\x00", b"\x00" * 1000, b"\xff\xfe", b"\xed\xa0\x80", b"\x1b[2J", b"\r", b"\n\n", b"\x85",
                        b"\xe2\x80\xae", b"'", b'"', b"<", b"{", b"\x0c", b"9" * 6000, b"\t"])  # fmt: skip
    ways = {
        "empty": lambda: b"",
        "blanks": lambda: b" \n\t\n",
        "cut": lambda: content[:at],
        "twice": lambda: content + content,
        "with a BOM": lambda: b"\xef\xbb\xbf" + content,
        "UTF-16": lambda: content.decode("latin-1").encode("utf-16"),
        "UTF-32": lambda: content.decode("latin-1").encode("utf-32"),
        "in CR": lambda: content.replace(b"\n", b"\r"),
        "noise": lambda: draw.randbytes(draw.choice([1, 50, 3000])),
        "zeros": lambda: bytes(draw.choice([1, 100, 3_000_000])),
        "a long line": lambda: b"a" * 3_000_000,
        "many lines": lambda: b"a: b\n" * 300_000,
        "deep": lambda: draw.choice([b"[", b"{a: ", b"- ", b"<a>", b'{"a":']) * 20_000,
        "gzip": lambda: zlib.compress(bytes(50_000_000)),
        "HTML": lambda: b"<!doctype html><html><body>404</body></html>",
        "a page of Git LFS": lambda: b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n",
        "code": lambda: b"import os; open('ran', 'w')\n",
        "junk within": lambda: content[:at] + junk + content[at:],
        "junk in place": lambda: content[:at] + junk + content[at + len(junk) :],
        "flipped": lambda: (
            content[:at] + bytes(255 - one for one in content[at : at + 1]) + content[at + 1 :]
        ),
    }
    what = draw.choice([*ways, "junk within", "junk in place", "flipped"])
    return ways[what](), f"{what} at {at}"


def spoil_yaml(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    how = draw.random()
    if how < 0.08:
        return draw.choice([bomb(), merge_bomb()]).encode() + content, "a bomb"
    if how < 0.75:
        tree = yaml.safe_load(content)
        text, told = spoil_tree(
            tree, draw, lambda one: yaml.safe_dump(one, allow_unicode=True, sort_keys=False), True
        )
        return text.encode("utf-8", "surrogatepass"), told
    return spoil_bytes(content, draw)


def spoil_json(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    if draw.random() < 0.7:
        text, told = spoil_tree(json.loads(content), draw, json.dumps, False)
        return text.encode(), told
    return spoil_bytes(content, draw)


def spoil_urdf(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    text, how = content.decode(), draw.random()
    if how < 0.55:
        parts = text.split('"')
        k = 2 * draw.randrange(len(parts) // 2) + 1
        parts[k] = draw.choice(["", "0", "-1", "nan", "inf", "1e308", "1e31", "-1e-320", "0 0 0", "1 2", "a", "x" * 9000,
                                "one", "base", "j1", "../x", "&amp;#27;", "\u202e", "{x}", "fixed", "floating", "planar",
                                "0x10", "1,5", "1 2 3 4", "&lt;", "9" * 6000])  # fmt: skip
        return '"'.join(parts).encode(), f"value {k} is {parts[k][:20]!r}"
    ways = {
        "entities": '<!DOCTYPE r [<!ENTITY a "aaaa">' + "".join(
            f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
        ) + "]>" + text.replace('name="duo"', 'name="&i;"'),
        "a file": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + text.replace("</robot>", "&x;</robot>"),
        "an include": text.replace("</robot>", '<x:include xmlns:x="http://www.w3.org/2001/XInclude" href="/etc/passwd"/></robot>'),
        "a loop": text.replace('<parent link="base"/>', '<parent link="two"/>'),
        "no joint": '<robot name="x"><link name="base"/></robot>',
        "many links": text.replace("</robot>", "".join(LINK.format(f"x{k}", 1) for k in range(7000)) + "</robot>"),
        "a long chain": text.replace("</robot>", "".join(
            LINK.format(f"x{k}", 1) + JOINT.format(f"y{k}", f"x{k - 1}" if k else "two", f"x{k}", 1) for k in range(300)
        ) + "</robot>"),
        "a mimic": text.replace("<limit", '<mimic joint="j1" multiplier="2"/><limit'),
        "a mesh": text.replace("<inertial>", '<visual><geometry><mesh filename="package://../../etc/passwd"/></geometry></visual><inertial>'),
        "xacro": text.replace("<robot", '<robot xmlns:xacro="http://x"').replace('value="4"', 'value="${open(1)}"'),
        "two joints of a name": text.replace('"j2"', '"j1"'),
        "odd names": text.replace('"j1"', draw.choice(['"yes"', '"1"', '"null"', '"*a"', '"a: b"', '"x #y"', '"é"', '"-"',
                                                        '"a&#10;b"', '"~"', '"[1"', '"=x"', '"a&quot;b"', '"."'])),
        "no limits": text.replace("<limit", "<nolimit"),
        "light": text.replace('<mass value="2"/>', '<mass value="1e-12"/>'),
        "no inertia": text.replace("inertial", "inert"),
        "latin-1": text.replace("one", "ünë"),
        "prismatic": text.replace("revolute", "prismatic"),
        "continuous": text.replace("revolute", "continuous"),
    }  # fmt: skip
    if how < 0.8:
        what = draw.choice(list(ways))
        return ways[what].encode("latin-1" if what == "latin-1" else "utf-8"), what
    return spoil_bytes(content, draw)


def spoil_csv(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    if draw.random() < 0.3:
        return spoil_bytes(content, draw)
    lines = content.decode().splitlines()
    cells = [line.split(",") for line in lines]
    row, column = draw.randrange(len(cells)), draw.randrange(len(cells[0]))
    odd = draw.choice(["", "nan", "inf", "-inf", "1e308", "1e400", "x", "2024-01-01", "True", "0x10", "1_0", '"a\nb"',
                       "\x1b[2J", "=cmd|' /C calc'!A0", "9" * 500, "-", "1.2.3", "1,5", "'", '"', "\u202e1", "\u0661", "#"])  # fmt: skip

    def whole(change):
        for one in cells[1:]:
            one[column] = change(one[column])

    def order():
        rows = cells[1:]
        draw.shuffle(rows)
        cells[1:] = rows

    ways = {
        "a cell": lambda: put(cells, (row, column), odd),
        "a header": lambda: put(cells, (0, column), draw.choice(["t", "q_j1", "", "a\x1b[2J", "é", "T", "q_j1 [deg]", odd])),
        "a column of one": lambda: whole(lambda one: odd),
        "a column of zeros": lambda: whole(lambda one: "0"),
        "a large column": lambda: whole(lambda one: str(float(one) * draw.choice([1e29, 1e200, -1e9]))),
        "a column less": lambda: [one.pop(column) for one in cells],
        "a column more": lambda: [one.append("1") for one in cells[1:]],
        "a ragged row": lambda: cells[row].append("1"),
        "a short row": lambda: cells[row].pop(),
        "shuffled": order,
        "time back": lambda: put(cells, (row, 0), "-5" if row else "t"),
        "time stands": lambda: [put(one, (0,), "1") for one in cells[1:]],
        "time in years": lambda: [put(one, (0,), str(float(one[0]) * 1e9)) for one in cells[1:]],
        "rows twice": lambda: cells.extend(cells[1:]),
        "no rows": lambda: cells.__delitem__(slice(1, None)),
        "few rows": lambda: cells.__delitem__(slice(1 + draw.randrange(5), None)),
        "many columns": lambda: [one.extend(["1"] * 2500) for one in cells],
        "no header": lambda: cells.pop(0),
        "open quote": lambda: put(cells, (row, column), '"1'),
        "comments": lambda: cells.insert(row, ["# a"]),
        "a blank row": lambda: cells.insert(row, [""]),
        "one column": lambda: [one.__delitem__(slice(1, None)) for one in cells],
    }  # fmt: skip
    what = draw.choice([*ways, "a cell", "a cell"])
    ways[what]()
    separator = draw.choice([",", ",", ",", ";", "\t", "|", " ", ", "])
    return "\n".join(map(separator.join, cells)).encode(
        "utf-8", "surrogatepass"
    ), f"{what} ({separator!r}, {odd[:20]!r})"


def spoil_parquet(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    if draw.random() < 0.35:
        return spoil_bytes(content, draw)
    table = pq.read_table(io.BytesIO(content))
    name = draw.choice(table.column_names)
    k, n = table.column_names.index(name), len(table)
    kinds = {
        "text": pa.array(["x"] * n),
        "numbers as text": pa.array(["1.5"] * n),
        "lists": pa.array([[1.0]] * n),
        "structs": pa.array([{"a": 1}] * n),
        "nothing": pa.nulls(n),
        "truths": pa.array([True] * n),
        "bytes": pa.array([b"\xff"] * n),
        "dates": pa.array([2**60] * n, pa.timestamp("ns")),
        "dates of a zone": pa.array([1] * n, pa.timestamp("ns", tz="Mars/Base")),
        "decimals": pa.array([1] * n, pa.decimal128(30, 2)),
        "a dictionary": pa.array(["x"] * n).dictionary_encode(),
        "huge": pa.array([1e308] * n),
        "NaN": pa.array([float("nan")] * n),
        "large whole numbers": pa.array([2**63 - 1] * n),
        "a hole": pa.array([None if i == 5 else 1.0 for i in range(n)]),
        "times": pa.array([1] * n, pa.time64("us")),
        "half": pa.array(np.ones(n, dtype=np.float16)),
    }
    what = draw.choice(
        [*kinds, "no rows", "gone", "twice", "odd names", "bomb", "odd pandas", "wide", "nested names"]
    )
    out = io.BytesIO()
    if what in kinds:
        table = table.set_column(k, name, kinds[what])
    elif what == "no rows":
        table = table[:0]
    elif what == "gone":
        table = table.remove_column(k)
    elif what == "twice":
        table = table.append_column(name, table[name])
    elif what == "odd names":
        table = table.rename_columns(
            [
                draw.choice(["", "\x1b[2J", "a\nb", "\u202e", "__index_level_0__"]) + str(i)
                for i in range(table.num_columns)
            ]
        )
    elif what == "odd pandas":
        table = table.replace_schema_metadata({b"pandas": b'{"index_columns": ["x"], "columns": [{}]}'})
    elif what == "wide":
        table = pa.table({f"c{i}": pa.array([1.0]) for i in range(4000)})
    elif what == "nested names":
        table = table.append_column("a.b", table[name])
    if what == "bomb":
        with pq.ParquetWriter(out, pa.schema([("t", pa.float64())])) as writer:
            zeros = pa.table({"t": pa.array(np.zeros(5_000_000))})
            for _ in range(60):
                writer.write_table(zeros)
    else:
        pq.write_table(table, out)
    return out.getvalue(), f"{what} at {name}"


def spoil_html(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    return spoil_bytes(content, draw)


def spoil_code(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    """Files of own code that are none, or break the agreement; what endless code does, `time_limit` bounds."""
    if draw.random() < 0.3:
        return spoil_bytes(content, draw)
    text = content.decode()
    name = text.partition(" = ")[0].splitlines()[-1] if " = " in text else "x"
    ways = {
        "a stray indent": text + "\n  x = 1",
        "an import of nothing": "import nothing_of_this_name\n" + text,
        "an exit": "import sys; sys.exit(3)\n",
        "an exception": "raise KeyError('\\x1b[2J\\n')\n",
        "an odd exception": "class E(Exception):\n    def __str__(self):\n        raise E\nraise E\n",
        "no name in it": "x = 1\n",
        "another kind": f"{name} = 3\n",
        "deep": "x = " + "(" * 500 + ")" * 500,
        "a bare class": text.replace("def ", "def _"),
        "recursion": "def f():\n    f()\nf()\n",
        "returned nothing": text.replace("return ", "return None and "),
        "returned text": text.replace("return ", "return 'x' or "),
        "returned NaN": text.replace("return ", "return float('nan') * "),
    }
    what = draw.choice(list(ways))
    return ways[what].encode(), what


def spoil_archive(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    how = draw.random()
    if how < 0.3:
        return spoil_bytes(content, draw)
    with tarfile.open(fileobj=io.BytesIO(content)) as tar:
        members = [(one.name, tar.extractfile(one).read()) for one in tar]
    k = draw.randrange(len(members))
    told, suffix = "", ""
    out = io.BytesIO()
    if how < 0.6:
        spoil = {".json": spoil_json, ".yaml": spoil_yaml, ".parquet": spoil_parquet, ".html": spoil_html}
        k = 0 if draw.random() < 0.5 else k
        made, told = spoil.get(Path(members[k][0]).suffix, lambda one, draw: spoil_bytes(one, draw))(
            members[k][1], draw
        )
        members[k] = (members[k][0], made)
        if draw.random() < 0.8:
            sign(members)
    elif how < 0.8:
        name = draw.choice(["../ran", "/tmp/ran", "a/../../ran", "x" * 300, "a\nb", "\x1b[2J", "evil.py", "-rf", "\u202e",
                            ".bashrc", "results/../x", "a\\b", "", ".", "config.yaml/x", "nul\x00", "é" * 90])  # fmt: skip
        members[k] = (name, members[k][1])
        told = f"named {name[:20]!r}"
        if draw.random() < 0.7:
            sign(members)
    else:
        suffix = draw.choice(["gz", "bz2", "xz"])
        told = f"packed as {suffix}"
    with tarfile.open(fileobj=out, mode=f"w:{suffix}", format=draw.choice([0, 1, 2])) as tar:
        for i, (name, one) in enumerate(members):
            member = tarfile.TarInfo(name)
            member.size = len(one)
            if how > 0.8 and i == k and not suffix:
                member.type, member.linkname, member.size = (
                    draw.choice([b"1", b"2", b"3", b"5", b"6"]),
                    "/etc/passwd",
                    0,
                )
            try:
                tar.addfile(member, io.BytesIO(one))
            except (ValueError, UnicodeError):
                continue
    return out.getvalue(), told


def sign(members: list[tuple[str, bytes]]) -> None:
    """Checksums such as whoever packs an archive can make them."""
    import hashlib

    try:
        manifest = json.loads(members[0][1])
        manifest["files"] = {
            name: {"sha256": hashlib.sha256(one).hexdigest(), "bytes": len(one)}
            for name, one in members[1:]
            if name != "MANIFEST.sha256"
        }
        text = json.dumps(manifest).encode()
    except (ValueError, TypeError, KeyError):
        text = members[0][1]
    members[0] = (members[0][0], text)
    for i, (name, _) in enumerate(members):
        if name == "MANIFEST.sha256":
            members[i] = (name, f"{hashlib.sha256(text).hexdigest()}  MANIFEST.json\n".encode())


def spoil_place(path: Path, draw: random.Random) -> str:
    """What is no plain file where one should be."""
    content = path.read_bytes()
    path.unlink()

    def listen():
        here = os.getcwd()
        os.chdir(path.parent)
        try:
            with socket.socket(socket.AF_UNIX) as server:
                server.bind(path.name)
        finally:
            os.chdir(here)

    ways = {
        "gone": lambda: None,
        "a folder": path.mkdir,
        "a pipe": lambda: os.mkfifo(path),
        "a socket": listen,
        "a link to itself": lambda: path.symlink_to(path),
        "a link to nowhere": lambda: path.symlink_to("nothing"),
        "a link to zeros": lambda: path.symlink_to("/dev/zero"),
        "a link outside": lambda: path.symlink_to("/etc/passwd"),
        "a large hole": lambda: (path.touch(), os.truncate(path, 30 << 30)),
        "unreadable": lambda: (path.write_bytes(content), path.chmod(0)),
    }
    what = draw.choice(list(ways))
    ways[what]()
    return what


SPOIL = {
    ".yaml": spoil_yaml, ".json": spoil_json, ".urdf": spoil_urdf, ".csv": spoil_csv, ".parquet": spoil_parquet,
    ".html": spoil_html, ".py": spoil_code, ".tar": spoil_archive, ".png": spoil_html,
}  # fmt: skip


# ------------------------------------------------------------------------------------------------ the subjects


def write_dataset(folder: Path, servo: bool = False) -> None:
    folder.mkdir(parents=True)
    fields = {**FIELDS, "servo": SERVO} if servo else FIELDS
    (folder / "dataset.yaml").write_text(yaml.safe_dump(fields, sort_keys=False))
    (folder / "robot.urdf").write_text(URDF)
    make_table(0).to_csv(folder / "a.csv", index=False, float_format="%.5f")
    make_table(1).to_parquet(folder / "b.parquet", index=False)


MODEL = """name: duo
urdf: robot.urdf
joints: [j1, j2]
gravity: [0, 0, -9.81]
drive:
  gear_ratio: [100, 100]
  rotor_inertia: [0.5, 0.5]
  torque_limit: [80, 80]
  speed_limit: [3, 3]
  acceleration_limit: [15, 15]
  jerk_limit: [150, 150]
sensors: {encoder_resolution: [1.0e-06, 1.0e-06], torque_noise: [0.2, 0.2], sample_rate: 250}
payload: {mass: 0.3, com: [0, 0, 0.05]}
controller: {bandwidth_hz: 6.0, damping: 1.0}
home: [0, 0]
wear_axes: [j1, j2]
effects:
- joint: j1
  effect: friction_wear_temperature
  parameters: {eta0: 2, eta1: -1.6, eta2: 0.1, eta3: -0.25, eta4: 0.0098, eta5: 1.76, eta6: -0.019, eta7: 0.064, eta8: 0.004,
    eta9: 0.0152, alpha: 1}
- joint: j2
  effect: friction_wear_temperature
  parameters: {eta0: 2, eta1: -1.6, eta2: 0.1, eta3: -0.25, eta4: 0.0098, eta5: 1.76, eta6: -0.019, eta7: 0.064, eta8: 0.004,
    eta9: 0.0152, alpha: 1}
"""
VERDICT = {
    "joints": {"j1": {"rms_before": 2.0, "rms_after": 1.0, "unit": "N m"}, "j2": {"rms_before": 1.0, "rms_after": 1.0}},
    "verdict": [{"joint": "j1", "effect": "stribeck", "confidence": 0.9}], "dataset_digest": "0", "status": "named",
}  # fmt: skip
PAGE = (
    '<html><body><div class="strip conclusion good"><p class="answer">It is <b>so</b>.</p><dl><dt>How sure</dt><dd>very</dd>'
    "<dt>Mind</dt><dd>little</dd><dt>Next</dt><dd>go on</dd></dl></div></body></html>"
)
LEROBOT = {
    "codebase_version": "v2.1", "fps": 100, "features": {
        "observation.state": {"dtype": "float32", "shape": [2], "names": ["j1.pos", "j2.pos"]},
        "observation.effort": {"dtype": "float32", "shape": [2], "names": {"motors": ["j1", "j2"]}},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    },
}  # fmt: skip


def write_robot(folder: Path) -> None:
    """A model of the arm."""
    folder.mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    (folder / "model.yaml").write_text(MODEL)


def write_loop(folder: Path) -> None:
    """Results of a loop, as far as what compares and lists them reads."""
    folder.mkdir(parents=True)
    (folder / "verdict.json").write_text(json.dumps(VERDICT))
    (folder / "report.html").write_text(PAGE)
    write_ranking(folder)


def write_ranking(folder: Path) -> None:
    """The table of a study that says which detector is best."""
    columns = ("rank", "rank_low", "rank_high", "median", "median_low", "median_high")
    pq.write_table(
        pa.table({"fda": ["A", "B"], **{name: [1.0, 2.0] for name in columns}}), folder / "ranking.parquet"
    )


def write_lerobot(folder: Path) -> None:
    """A data set of LeRobot of three episodes."""
    (folder / "meta").mkdir(parents=True)
    (folder / "data").mkdir()
    (folder / "meta" / "info.json").write_text(json.dumps(LEROBOT))
    table = make_table(0)
    lists = {"state": table[["q_j1", "q_j2"]], "effort": table[["tau_j1", "tau_j2"]]}
    columns = {f"observation.{name}": one.to_numpy().tolist() for name, one in lists.items()}
    columns |= {"timestamp": table["t"], "episode_index": np.arange(len(table)) * 3 // len(table)}
    pq.write_table(pa.table(columns), folder / "data" / "a.parquet")


def write_study(folder: Path) -> None:
    """A small study of the arm with code of its own."""
    write_robot(folder / "arm")
    text = (ROOT / "config" / "quick.yaml").read_text()
    settings = yaml.safe_load(text) | {"time_limit": 5, "export": {"model": "arm"}, "allow_code": []}
    (folder / "config").mkdir()
    (folder / "config" / "config.yaml").write_text(yaml.safe_dump(settings, sort_keys=False))


def write_archive(path: Path) -> None:
    """A packed study."""
    members = [
        ("MANIFEST.json", json.dumps(MANIFEST).encode()), ("MANIFEST.sha256", b""), ("config.yaml", b"study: tiny\nseed: 0\n"),
        ("report.html", PAGE.encode()), ("verdict.json", json.dumps(VERDICT).encode()),
    ]  # fmt: skip
    table = io.BytesIO()
    pq.write_table(
        pa.table({"fda": ["A"], "rank": [1.0], "rank_low": [1.0], "rank_high": [2.0], "median": [3.0]}), table
    )
    members.append(("ranking.parquet", table.getvalue()))
    sign(members)
    with tarfile.open(path, "w") as tar:
        for name, content in members:
            member = tarfile.TarInfo(name)
            member.size = len(content)
            tar.addfile(member, io.BytesIO(content))


MANIFEST = {
    "format": 2, "study": "tiny", "config": {"study": "tiny", "seed": 0}, "python": "3.11", "packages": {"numpy": "2"},
    "code": {"wearscope": "0.3.0", "commit": None, "changed": False, "sha256": "0" * 64, "files": {}, "date": None},
    "inputs": {}, "files": {},
}  # fmt: skip


def write_own(folder: Path, kind: str) -> None:
    """A file of own code, as `wearscope new` makes it."""
    from jinja2 import Template

    text = (ROOT / "src" / "wearscope" / "starters" / "templates" / f"{kind}.py.jinja").read_text()
    filled = Template(text).render(
        name="own", title="Own", description="d", unit="rad", unit_text="rad", points=[(0.3, 0.2)], speed=0.5
    )
    (folder / "own.py").write_text(filled)


def make_picture() -> bytes:
    """A PNG of two by two pixels."""
    rows = zlib.compress(b"\x00\x01\x02\x03\x04\x05\x06" * 2)
    parts = [(b"IHDR", bytes([0, 0, 0, 2, 0, 0, 0, 2, 8, 2, 0, 0, 0])), (b"IDAT", rows), (b"IEND", b"")]
    whole = [len(one).to_bytes(4) + kind + one + zlib.crc32(kind + one).to_bytes(4) for kind, one in parts]
    return b"\x89PNG\r\n\x1a\n" + b"".join(whole)


def write_shown(folder: Path, kind: str) -> None:
    """A table or picture."""
    frame = pd.DataFrame({"a": [1.0, 2.0], "b": ["x", "y"], "fda": ["A", "B"]})
    content = {
        "csv": lambda: frame.to_csv(index=False).encode(), "json": lambda: frame.to_json().encode(),
        "parquet": frame.to_parquet, "png": lambda: make_picture(),
    }  # fmt: skip
    (folder / f"a.{kind}").write_bytes(content[kind]())


@dataclass(frozen=True)
class Subject:
    """A command that reads files.

    Attributes
    ----------
    write : callable
        Makes sound files in a folder.
    files : tuple of str
        Those that are spoiled.
    arguments : tuple of str
        Of the command line.
    made : tuple of str
        What it makes, which is there whole or not at all.
    """

    write: Callable[[Path], None]
    files: tuple[str, ...]
    arguments: tuple[str, ...]
    made: tuple[str, ...] = ()


def _both(
    first: Callable[[Path], None], second: Callable[[Path], None], names: tuple[str, str]
) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        first(folder / names[0])
        second(folder / names[1])

    return write


_RECORDED = ("dataset.yaml", "robot.urdf", "a.csv", "b.parquet")
_DATA = tuple(f"data/{one}" for one in _RECORDED)
_CONVERT = (
    "new",
    "dataset",
    "data/a.csv",
    "data/b.parquet",
    "--urdf",
    "data/robot.urdf",
    "--name",
    "made",
    "--accept",
    "unrelated tau",
)
_ARCHIVE = lambda folder: write_archive(folder / "a.tar")  # noqa: E731
SUBJECTS = {
    "check dataset": Subject(lambda f: write_dataset(f / "data"), _DATA, ("check", "data")),
    "check servo": Subject(lambda f: write_dataset(f / "data", True), _DATA[:1], ("check", "data")),
    "check robot": Subject(lambda f: write_robot(f / "arm"), ("arm/model.yaml", "arm/robot.urdf"), ("check", "arm")),
    "check study": Subject(write_study, ("config/config.yaml",), ("check", ".")),
    "check detector": Subject(lambda f: write_own(f, "detector"), ("own.py",), ("check", "own.py")),
    "check effect": Subject(lambda f: write_own(f, "effect"), ("own.py",), ("check", "own.py")),
    "check cycle": Subject(lambda f: write_own(f, "cycle"), ("own.py",), ("check", "own.py")),
    "diagnose": Subject(lambda f: write_dataset(f / "data"), _DATA[:1], ("diagnose", "data", "-n"), ()),
    "track": Subject(lambda f: write_dataset(f / "data"), _DATA[:1], ("track", "data", "-n"), ()),
    "detect": Subject(lambda f: write_dataset(f / "data"), _DATA[:1], ("detect", "data", "-n"), ()),
    "run": Subject(write_study, ("config/config.yaml",), ("run", ".", "-n"), ()),
    "evaluate": Subject(
        _both(write_robot, write_dataset, ("arm", "data")), ("arm/model.yaml", "arm/robot.urdf", *_DATA),
        ("evaluate", "arm", "data", "--out", "made"), ("made",),
    ),
    "new robot": Subject(
        lambda f: write_robot(f / "arm"), ("arm/robot.urdf",), ("new", "robot", "arm/robot.urdf", "--name", "made"), ("made",)
    ),
    "new dataset": Subject(lambda f: write_dataset(f / "data"), _DATA[1:], _CONVERT, ("made",)),
    "lerobot": Subject(
        _both(write_lerobot, write_robot, ("set", "arm")), ("set/meta/info.json", "set/data/a.parquet"),
        ("new", "dataset", "set", "--urdf", "arm/robot.urdf", "--name", "made"), ("made",),
    ),
    "verify": Subject(_ARCHIVE, ("a.tar",), ("archive", "verify", "a.tar")),
    "unpack": Subject(_ARCHIVE, ("a.tar",), ("archive", "unpack", "a.tar", "made"), ("made",)),
    "restore": Subject(_ARCHIVE, ("a.tar",), ("archive", "restore", "a.tar", "."), ("results",)),
    "compare archives": Subject(
        lambda f: (write_archive(f / "a.tar"), write_archive(f / "b.tar")), ("a.tar",), ("compare", "a.tar", "b.tar")
    ),
    "compare loops": Subject(
        _both(write_loop, write_loop, ("a", "b")), ("a/verdict.json", "b/verdict.json"),
        ("compare", "a", "b"),
    ),
    "compare studies": Subject(
        lambda f: [((f / one).mkdir(), write_archive(f / one / "x.tar"), write_shown(f / one, "parquet"),
                    write_ranking(f / one)) for one in "ab"],
        ("a/ranking.parquet", "a/a.parquet"), ("compare", "a", "b"),
    ),
    "history": Subject(
        lambda f: [write_loop(f / one) for one in ("a", "b")],
        ("a/verdict.json", "a/report.html", "b/ranking.parquet"), ("history", "."), ("history.html",),
    ),
    "report": Subject(lambda f: write_loop(f / "a"), ("a/report.html",), ("report", "a")),
    **{
        f"show {kind}": Subject(lambda f, kind=kind: write_shown(f, kind), (f"a.{kind}",), ("show", f"a.{kind}", "--rows", "5"))
        for kind in ("csv", "json", "parquet", "png")
    },
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """An input: what was done to it, the command line, and what it makes."""

    told: str
    arguments: tuple[str, ...]
    made: tuple[str, ...]


def make_case(name: str, number: int, folder: Path) -> Case:
    """Write the n-th input of a subject into an empty folder; equal numbers give equal inputs."""
    subject, draw = SUBJECTS[name], random.Random(f"{name} {number}")
    subject.write(folder)
    path = folder / draw.choice(subject.files)
    if draw.random() < 0.08:
        told = spoil_place(path, draw)
    else:
        content, told = SPOIL[path.suffix](path.read_bytes(), draw)
        path.write_bytes(content)
    (folder / "evil.py").write_text(f"open({str(folder / RAN)!r}, 'w')\n")
    return Case(f"{path.name}: {told}", subject.arguments, subject.made)


# ------------------------------------------------------------------------------------------- bounded processes


@dataclass(frozen=True)
class Outcome:
    """How a command ended.

    Attributes
    ----------
    code : int
        Exit status, negative for a signal.
    output : str
    seconds : float
        Of processor.
    memory : int
        Largest [bytes].
    """

    code: int
    output: str
    seconds: float
    memory: int


class Runner:
    """Runs commands of the platform, each in a process forked from one that has imported them."""

    def __enter__(self) -> "Runner":
        self.server = subprocess.Popen(
            [sys.executable, "-P", __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __call__(self, arguments: tuple[str, ...], folder: Path) -> Outcome:
        print(json.dumps([arguments, str(folder)]), file=self.server.stdin, flush=True)
        return Outcome(**json.loads(self.server.stdout.readline()))

    def __exit__(self, *error: object) -> None:
        with self.server:  # closes both ends, and waits
            pass


def serve() -> None:
    """Run each command line of the standard input; tell how it ended."""
    import importlib

    from wearscope.cli.main import COMMANDS

    for place in {*COMMANDS.values(), "new_robot:", "new_dataset:"}:
        importlib.import_module(f"wearscope.cli.{place.split(':')[0]}")
    for module in ("archive", "checking.dataset", "checking.robot", "checking.study", "checking.own_code", "model_errors",
                   "starters.conversion", "starters.robot"):  # fmt: skip
        importlib.import_module(f"wearscope.{module}")
    for line in sys.stdin:
        arguments, folder = json.loads(line)
        print(json.dumps(asdict(run_forked(arguments, folder))), flush=True)


def run_forked(arguments: list[str], folder: str) -> Outcome:
    """Run one command line in a child."""
    said = Path(f"{folder}.said")
    child = os.fork()
    if not child:
        try:
            act(arguments, folder, said)
        finally:
            os._exit(99)
    end = time.monotonic() + WAITED
    while not (ended := os.wait4(child, os.WNOHANG))[0]:
        if time.monotonic() > end or measure_memory(child) > MEMORY:
            os.killpg(child, signal.SIGKILL)
            ended = os.wait4(child, 0)
            break
        time.sleep(0.02)
    _, status, used = ended
    with said.open("rb") as file:
        text = file.read(1_000_000).decode("utf-8", "backslashreplace")
    said.unlink()
    return Outcome(
        os.waitstatus_to_exitcode(status), text, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024
    )


def measure_memory(process: int) -> int:
    """Resident memory [bytes]; address space tells nothing, as JavaScript's engine reserves some of it."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize()


def act(arguments: list[str], folder: str, said: Path) -> None:
    os.setsid()
    os.chdir(folder)
    handle = os.open(said, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
    null = os.open(os.devnull, os.O_RDONLY)
    for old, new in ((null, 0), (handle, 1), (handle, 2)):
        os.dup2(old, new)
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS + 2, SECONDS + 3))
    code = 98
    try:
        if arguments[0] == "archive":
            from wearscope import archive

            code = archive.main(arguments[1:])
        else:
            from wearscope.cli import main

            sys.argv = ["wearscope", *arguments]
            main.main()
            code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        import traceback

        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def judge(case: Case, outcome: Outcome, folder: Path) -> str:
    """What is wrong with how a command ended; empty where nothing is."""
    text = outcome.output
    if (folder / RAN).exists() or (folder.parent / RAN).exists() or Path("/tmp", RAN).exists():
        return "code ran"
    if outcome.code not in (0, 1, 2) or "Traceback (most recent" in text:
        return f"exit status {outcome.code}: {text[-700:]}"
    if outcome.seconds > SECONDS or outcome.memory > MEMORY:
        return f"{outcome.seconds:.1f} s, {outcome.memory / 2**30:.2f} GiB"
    if not text.replace("\n", "").isprintable():
        return f"steers the terminal: {text[-300:]!r}"
    if outcome.code and not text.strip():
        return "ends without a word"
    left = [one for one in case.made if os.path.lexists(folder / one)] if outcome.code else []
    left += [str(one) for one in folder.glob("**/.*.part")]
    return f"leaves {', '.join(left)} and ends with {outcome.code}: {text[-300:]}" if left else ""


if __name__ == "__main__":
    serve()
