# ruff: noqa: E501
"""Bags of joint states, and what is odd about their messages, their database and their description."""

import random
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from hostile.samples import make_table
from hostile.trees import spoil_bytes, spoil_yaml

#: What becomes of a message: its row, stamp [ns], and fields.
MESSAGES: dict[str, Callable[[int, dict[str, Any]], None]] = {
    "as they should be": lambda row, one: None,
    "a stamp of zero": lambda row, one: one.update(stamp=0),
    "a stamp far away": lambda row, one: one.update(stamp=one["stamp"] + (row > 300) * 10**18),
    "a negative stamp": lambda row, one: one.update(stamp=-one["stamp"]),
    "stamps that alternate": lambda row, one: one.update(stamp=one["stamp"] + row % 2 * 3600 * 10**9),
    "one stamp": lambda row, one: one.update(stamp=10**18),
    "no names": lambda row, one: one.update(name=[]),
    "a name twice": lambda row, one: one.update(name=["j1", "j1"]),
    "names that change": lambda row, one: one.update(name=[f"j1_{row}", "j2"]),
    "names that steer": lambda row, one: one.update(name=["\x1b[2J", "a\nb: [c]"]),
    "long names": lambda row, one: one.update(name=["x" * 5000, "j2"]),
    "fewer efforts": lambda row, one: one.update(effort=one["effort"][: row % 3]),
    "no effort": lambda row, one: one.update(effort=one["effort"][:0]),
    "effort now and then": lambda row, one: one.update(effort=one["effort"][: 2 * (row % 5 == 0)]),
    "not a number": lambda row, one: one.update(position=one["position"] * (np.nan if row % 9 == 4 else 1)),
    "infinite": lambda row, one: one.update(position=one["position"] * (np.inf if row == 77 else 1)),
    "huge": lambda row, one: one.update(effort=one["effort"] * 1e300),
    "many joints": lambda row, one: one.update(name=[f"k{k}" for k in range(2500)], position=np.ones(2500), effort=np.ones(2500)) if row < 3 else None,
}  # fmt: skip
#: What is done to the database of a bag: statements that a reader would run, or never end at.
STATEMENTS = {
    "messages without end": (
        "ALTER TABLE messages RENAME TO kept",
        "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
        "SELECT i AS id, 1 AS topic_id, i * 10000000 AS timestamp, (SELECT data FROM kept LIMIT 1) AS data FROM n",
    ),
    "large messages": ("UPDATE messages SET data = zeroblob(300000000) WHERE id = 3",),
    "text for messages": ("UPDATE messages SET data = 'x'",),
    "no messages": ("DELETE FROM messages",),
    "messages of no topic": ("UPDATE messages SET topic_id = 77",),
    "stamps of text": ("UPDATE messages SET timestamp = 'x'",),
    "an odd type": ("UPDATE topics SET type = '../../x/msg/Y'",),
    "an odd topic": ("UPDATE topics SET name = char(27) || '[2J'",),
    "no tables": ("DROP TABLE messages",),
    "cut messages": ("UPDATE messages SET data = substr(data, 1, 30)",),
    "a length of billions": ("UPDATE messages SET data = substr(data, 1, 16) || x'ffffff7f' || substr(data, 21)",),
}  # fmt: skip


def write_states(
    folder: Path, messages: Iterable[tuple[int, int, dict[str, Any]]], storage: StoragePlugin
) -> None:
    """Joint states as a bag: when each was received [ns], its own stamp [ns], and its fields."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, time = (
        store.types[name]
        for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    with Writer(folder, version=8, storage_plugin=storage) as writer:
        link = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for received, stamp, fields in messages:
            sec, nanosec = divmod(stamp, 10**9)
            sec = (sec + 2**31) % 2**32 - 2**31  # as 32 bits hold it
            stated = header(stamp=time(sec=sec, nanosec=nanosec), frame_id="")
            message = state(header=stated, **{"velocity": np.zeros(0), **fields})
            writer.write(link, received, store.serialize_cdr(message, state.__msgtype__))


def write_bag(
    folder: Path, change: str = "as they should be", storage: StoragePlugin = StoragePlugin.SQLITE3
) -> None:
    """A bag of both joints, its messages changed in one way."""
    table, messages = make_table(0), []
    q, tau = (table[[f"{kind}_j1", f"{kind}_j2"]].to_numpy() for kind in ("q", "tau"))
    for row, t in enumerate(table["t"]):
        received = 1_716_190_000_000_000_000 + round(t * 1e9)
        one = {"stamp": received, "name": ["j1", "j2"], "position": q[row].copy(), "effort": tau[row].copy()}
        MESSAGES[change](row, one)
        messages.append((received, one.pop("stamp"), one))
    write_states(folder, messages, storage)


def write_odd_bag(folder: Path, draw: random.Random) -> str:
    """Write a bag; what is odd about it."""
    how, bag = draw.choice(["messages", "messages", "statements", "bytes", "about"]), folder / "bag"
    storage = draw.choice([StoragePlugin.SQLITE3, StoragePlugin.MCAP])
    what = draw.choice(list(MESSAGES)) if how == "messages" else "as they should be"
    write_bag(bag, what, StoragePlugin.SQLITE3 if how == "statements" else storage)
    if how == "statements":
        what = draw.choice(list(STATEMENTS))
        with sqlite3.connect(next(bag.glob("*.db3"))) as database:
            for statement in STATEMENTS[what]:
                database.execute(statement)
        database.close()
    elif how != "messages":
        path = next(bag.glob("*.db3" if storage == StoragePlugin.SQLITE3 else "*.mcap"))
        path = bag / "metadata.yaml" if how == "about" else path
        content, what = (spoil_yaml if how == "about" else spoil_bytes)(path.read_bytes(), draw)
        path.write_bytes(content)
    return f"{how}: {what}"
