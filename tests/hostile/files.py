# ruff: noqa: E501
"""Spoiled URDF, own code and archives, and what is no plain file."""

import io
import json
import os
import random
import socket
import tarfile
from pathlib import Path

from hostile.samples import JOINT, LINK, sign
from hostile.tables import spoil_parquet
from hostile.trees import spoil_bytes, spoil_json, spoil_yaml


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
        "a stated encoding": f'<?xml version="1.0" encoding="{draw.choice(["utf-16", "utf-7", "cp037", "none", "ISO-8859-1"])}"?>' + text,
        "an instruction": "<?xml-stylesheet href='file:///etc/passwd'?>" + text,
        "a namespace": text.replace("<robot", '<robot xmlns="http://x/y"', 1),
        "capitals": text.replace("<joint", "<Joint").replace("</joint", "</Joint"),
        "text between": text.replace("<link", "some text <![CDATA[<link/>]]> <link"),
        "an attribute twice": text.replace('value="4"', 'value="4" value="5"'),
        "many attributes": text.replace("<robot", "<robot " + " ".join(f'a{k}="1"' for k in range(50_000)), 1),
        "an axis of zero": text.replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"'),
        "limits that cross": text.replace('lower="-2" upper="2"', 'lower="2" upper="-2"'),
        "a negative mass": text.replace('value="2"', 'value="-2"'),
        "an inertia that no body has": text.replace('ixx="0.2"', 'ixx="2000"'),
        "a turn without end": text.replace('<origin xyz="0 0 0.3"/>', '<origin xyz="0 0 0.3" rpy="1e300 -1e17 1e9"/>'),
        "names that look alike": text.replace('"j2"', '"\u2170"').replace('"j1"', '"\u0456"'),
        "blanks around names": text.replace('"j1"', '" j1 "'),
        "mimics in a ring": text.replace("<limit", '<mimic joint="j2"/><limit', 1).replace('"j2" type="revolute">', '"j2" type="revolute"><mimic joint="j1"/>'),
        "two roots": text.replace("</robot>", '<link name="alone"/></robot>'),
        "parts of a simulator": text.replace("</robot>", "<gazebo><plugin filename='x.so'/></gazebo><transmission name='t'/></robot>"),
    }  # fmt: skip
    if how < 0.8:
        what = draw.choice(list(ways))
        return ways[what].encode("latin-1" if what == "latin-1" else "utf-8"), what
    return spoil_bytes(content, draw)


def spoil_code(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    """Files of own code that are none, or break the agreement; what endless code does, `time_limit` bounds."""
    if draw.random() < 0.3:
        made, told = spoil_bytes(content, draw)
        return made.replace(b"'ran'", b"'own'"), told  # which the command names, so that it runs
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
        spoil = {".json": spoil_json, ".yaml": spoil_yaml, ".parquet": spoil_parquet}
        k = 0 if draw.random() < 0.5 else k
        made, told = spoil.get(Path(members[k][0]).suffix, lambda one, draw: spoil_bytes(one, draw))(
            members[k][1], draw
        )
        members[k] = (members[k][0], made)
        if draw.random() < 0.8:
            sign(members)
    elif how < 0.63:
        odd = ("VERDICT.json", "verdict.json/", "e\u0301.json", "\u00e9.json")
        again = draw.choice([*(name for name, _ in members), *odd])
        members.append((again, b"other"))
        told = f"{again!a} too"
        sign(members)
    elif how < 0.65:
        manifest = json.loads(members[0][1])
        manifest |= {"study": draw.choice(["closed_loop", "tracking", "archive", "tiny", "."])}
        manifest["inputs"] = dict.fromkeys(
            ["/dev/stdin", "/proc/kmsg", "/dev/zero", "/dev/tty", "pipe"], "0" * 64
        )
        members[0] = (members[0][0], json.dumps(manifest).encode())
        told = f"study {manifest['study']}, inputs that have no end"
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
            member.mtime = draw.choice([0, 0, -1, 2**33]) if how < 0.6 else 0
            member.mode = draw.choice([0o644, 0o6777, 0])
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
        "a large hole": lambda: (path.touch(), os.truncate(path, 3 << 30)),
        "unreadable": lambda: (path.write_bytes(content), path.chmod(0)),
    }
    what = draw.choice(list(ways))
    ways[what]()
    return what
