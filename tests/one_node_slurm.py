"""A SLURM of one node, this machine, from Debian's packages; no accounting, nothing outside a folder."""

import getpass
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calls import call

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "srun", "squeue", "scontrol", "sinfo")
INSTALL = "apt-get install -y --no-install-recommends slurmctld slurmd slurm-client munge"


class NoSlurm(Exception):
    """Why there is none here, in one sentence."""


def find_obstacle() -> str | None:
    """Why no SLURM can be started here; None where it can."""
    if os.geteuid() != 0:
        return "a one-node SLURM is started as root, which these tests do not run as"
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    return f"not installed: {', '.join(missing)}; {INSTALL}" if missing else None


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def write_configuration(folder: Path, cores: int) -> Path:
    """Write slurm.conf; memory is consumable, so that a job that declares too much waits for ever."""
    host = socket.gethostname().partition(".")[0]
    megabytes = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    lines = {
        "ClusterName": "one",
        "SlurmctldHost": f"{host}(127.0.0.1)",
        "SlurmUser": getpass.getuser(),
        "SlurmdUser": getpass.getuser(),
        "AuthType": "auth/munge",
        "AuthInfo": f"socket={folder}/munge.socket",
        "CredType": "cred/munge",
        "SlurmctldPort": free_port(),
        "SlurmdPort": free_port(),
        "StateSaveLocation": folder / "state",
        "SlurmdSpoolDir": folder / "spool",
        "SlurmctldPidFile": folder / "slurmctld.pid",
        "SlurmdPidFile": folder / "slurmd.pid",
        "SlurmctldLogFile": folder / "slurmctld.log",
        "SlurmdLogFile": folder / "slurmd.log",
        "ProctrackType": "proctrack/linuxproc",
        "TaskPlugin": "task/none",
        "JobAcctGatherType": "jobacct_gather/none",
        "AccountingStorageType": "accounting_storage/none",
        "SelectType": "select/cons_tres",
        "SelectTypeParameters": "CR_CPU_Memory",
        "SchedulerParameters": "batch_sched_delay=0,sched_min_interval=0",
        "ReturnToService": 2,
        "MpiDefault": "none",
        "SlurmdParameters": "config_overrides",
    }
    text = "\n".join(f"{name}={value}" for name, value in lines.items())
    text += f"\nNodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory={megabytes} State=UNKNOWN\n"
    text += f"PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP\n"
    (folder / "slurm.conf").write_text(text)
    return folder / "slurm.conf"


@contextmanager
def start_slurm(folder: Path, cores: int = 1) -> Iterator[dict[str, str]]:
    """Run a one-node SLURM; yields the environment in which its commands find it."""
    if obstacle := find_obstacle():
        raise NoSlurm(obstacle)
    for name in ("state", "spool"):
        (folder / name).mkdir(parents=True)
    folder.chmod(0o755)
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o600)
    environment = {**os.environ, "SLURM_CONF": str(write_configuration(folder, cores))}
    # Within a job the plugin clears SLURM_CONF, as a cluster's is in /etc; this one's is not.
    (folder / "bin").mkdir()
    wrapper = folder / "bin" / "srun"
    wrapper.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {shutil.which("srun")} "$@"\n')
    wrapper.chmod(0o755)
    environment["PATH"] = f"{folder}/bin:{environment['PATH']}"
    names = {"key-file": "munge.key", "socket": "munge.socket", "pid-file": "munged.pid"}
    names |= {"log-file": "munged.log", "seed-file": "munged.seed"}
    options = [f"--{option}={folder}/{name}" for option, name in names.items()]
    commands = [["munged", "--foreground", "--force", *options], ["slurmctld", "-D"], ["slurmd", "-D"]]
    running: list[subprocess.Popen] = []
    try:
        for command in commands:
            with open(folder / f"{command[0]}.out", "wb") as out:
                running.append(subprocess.Popen(command, env=environment, stdout=out, stderr=out))
            time.sleep(1)
        wait_for_node(environment, running, folder)
        yield environment
    finally:
        for process in reversed(running):
            process.terminate()
        for process in reversed(running):
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()


def wait_for_node(environment: dict[str, str], running: list[subprocess.Popen], folder: Path) -> None:
    """Wait until the node is idle, at most a minute."""
    state = ""
    for _ in range(60):
        for process in running:
            if process.poll() is not None:
                name = process.args[0]  # type: ignore[index]
                told = (folder / f"{name}.out").read_text(errors="replace").strip().splitlines()[-1:]
                raise NoSlurm(f"{name} does not start here: {' '.join(told)}")
        asked = call("sinfo", "--noheader", "--format=%T", env=environment)
        state = asked.stdout.strip() or asked.stderr.strip()
        if state == "idle":
            return
        time.sleep(1)
    raise NoSlurm(f"the node of the one-node SLURM is not ready after a minute: {state}")
