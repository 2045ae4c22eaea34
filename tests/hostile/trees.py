# ruff: noqa: E501
"""Spoiled bytes, YAML and JSON."""

import json
import random
import zlib
from collections.abc import Callable

import yaml

ODD = [
    None, True, False, "", " ", "..", "../../etc/passwd", "/etc/passwd", "/dev/zero", "-rf", "--help", "~", "con",
    "a\x00b", "a\nb\rc", "\x1b[2J\x1b]0;x\x07", "\u202egpj.exe", "\ufeff", "\u2028", "{x}", "{{x}}", "$(touch ran)",
    "`touch ran`", "%s%n", "é" * 400, "x" * 100_000, "\U0001f600", "nan", "1e400", "0x1F", "1_000", "12:30:45",
    -1, 0, 2, 1e308, -1e308, 1e-320, 1e31, float("nan"), float("inf"), float("-inf"), 2**63, -(2**70), 10**39,
    [], {}, [[]], [None], {"": ""}, [1, "a", None], ["j1"] * 5, {"a": {"b": {"c": 1}}}, ["x"] * 3000,
    list(range(20_000)), "evil.py", ["evil.py"], {"use": "evil.py"}, {"allow_code": True},
    "a/../b", "A", "e\u0301", "\u00e9", "\u0456", "a.csv/", "./a.csv", "//a.csv", "a.csv\x00.txt", "file:///etc/passwd", "http://x/y",
    "1e5", "1_0", "-0.0", "0o17", "yes", "NO", "null", "~x", "2024-02-30", "\u0661\u0662", "%(a)s", "{0.__class__}", "\x7f", "\ud7ff",
    [True, False], [1, [2]], [float("nan")], {"mass": -1}, {"mass": 1e300, "com": [1e300] * 3}, {True: 1}, 1e-300, -0.0, 5e-324,
]  # fmt: skip
#: Texts in place of a value that only YAML knows.
WRITTEN = [
    "&a [*a]", "*none", "!!python/object/apply:os.system ['touch ran']", "!!python/name:os.system ''",
    "!!timestamp x", "!!bool maybe", "!!binary ab", "!!set {a}", "!!omap [a: 1]", "!!float x", "!!int ''", "!x y",
    "? [a]\n: b", "{<<: {a: 1}, <<: {b: 2}}", "{[1]: 2}", "{a: 1, a: 2}", "2024-13-45", "2024-01-01 25:00:00",
    "0o777777", ".nan", "-.inf", "1e999", "1" * 39, "9" * 5000, "0b1", "[" * 60 + "]" * 60, "[" * 3000, "{a: " * 50,
    "'", '"', "|\n", ">-\n  x", "@x", "%x", "\t", "=", "<<", "&b {x: &c [1, *b]}", "~ ~",
    "x\n---\ny: 1", "x\n...\ny: 1", "{null: 1}", "{true: 1, yes: 2}", "{1: a, 1.0: b}", "{2024-01-01: 1}", "1:2:3:4:5", "-1:59",
    "0x" + "f" * 300, "1e-400", "+.inf", "!!str 1", "!!null x", "!!map [a]", "!<tag:yaml.org,2002:python/tuple> [1]", "!!float 1_0:3",
    "\u2028", "{a: !!binary aGk=}", "[*a, &a b]", "{<<: [1]}", "{<<: x}", "{=: 1}", "|9\n x", "- - - - x", "? x", "!", "&", "*",
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


def spoil_often(spoil: Callable, content: bytes, count: int):
    """Contents that a sound one is spoiled to; equal numbers give equal ones."""
    for number in range(count):
        yield spoil(content, random.Random(f"{spoil.__name__} {number}"))[0]
