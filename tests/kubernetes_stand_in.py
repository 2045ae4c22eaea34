"""A stand-in for a Kubernetes cluster: its API as Snakemake's executor calls it, its pods as local processes.

Secrets, jobs, pods and logs only, as the API server answers; one node, one pod at a time. A pod gets a
private mount namespace: claims appear where its specification mounts them, its working folder is empty and
new, folders that only the user has are hidden, and the environment is the image's with the secrets that the
pod names. The image is this machine's Python, with a `pip` that installs nothing, as the image has the
storage plugin already.
"""

import base64
import json
import os
import queue
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from calls import call, start

IMAGE = "stand-in/wearscope:test"
UNSHARE = ["unshare", "--mount", "--propagation", "private"]
#: Exit code of a container that was ended by SIGKILL, as by the kernel for its memory.
KILLED = 128 + signal.SIGKILL


class NoStandIn(Exception):
    """Why there is none here, in one sentence."""


@dataclass
class Pod:
    """A job of the cluster, as it was submitted, and its one pod."""

    body: dict[str, Any]
    #: Of the container; None while it waits or runs.
    exit_code: int | None = None
    #: The node went away with the pod: the job has failed, and no pod is left to ask.
    lost: bool = False
    process: subprocess.Popen | None = None

    @property
    def name(self) -> str:
        return self.body["metadata"]["name"]

    @property
    def container(self) -> dict[str, Any]:
        (container,) = self.body["spec"]["template"]["spec"]["containers"]
        return container

    @property
    def command(self) -> str:
        """The shell's line."""
        return self.container["args"][-1]

    @property
    def rule(self) -> str:
        """That Snakemake's job runs; the first where it allows several."""
        return re.search(r"--allowed-rules '?(\w+)", self.command)[1]


@dataclass
class Cluster:
    """State of the stand-in: where it keeps claims, logs and programs, and the folders that no pod sees."""

    folder: Path
    hidden: list[Path]
    #: Given a pod before it starts: 'runs', 'killed' (once it has started) or 'lost' (with its node).
    fate: Callable[[Pod], str] = lambda pod: "runs"
    secrets: dict[str, dict[str, str]] = field(default_factory=dict)
    pods: dict[str, Pod] = field(default_factory=dict)
    submitted: list[Pod] = field(default_factory=list)
    calls: set[str] = field(default_factory=set)
    client: dict[str, str] = field(default_factory=dict)
    waiting: "queue.Queue[Pod | None]" = field(default_factory=queue.Queue)

    def claim(self, name: str) -> Path:
        """The folder of a persistent volume claim."""
        return self.folder / "claims" / name

    def mounts(self, pod: Pod) -> list[tuple[Path, str]]:
        """What is mounted where; raises KeyError where the pod names a volume that it does not declare."""
        volumes = {one["name"]: one for one in pod.body["spec"]["template"]["spec"]["volumes"]}
        found = []
        for mount in pod.container["volumeMounts"]:
            volume = volumes[mount["name"]]
            if "emptyDir" in volume:
                path = self.folder / "empty" / pod.name / mount["name"]
                path.mkdir(parents=True)
            else:
                path = self.claim(volume["persistentVolumeClaim"]["claimName"])
            found.append((path, mount["mountPath"]))
        return found

    def environment(self, pod: Pod) -> dict[str, str]:
        """The image's environment, and what the pod takes from secrets."""
        names = {"HOME": f"{self.folder}/image", "PATH": f"{self.folder}/image/bin:/usr/bin:/bin"}
        # What a site's image sets (docs/cluster.md).
        names["NUMBA_CACHE_DIR"] = f"{self.folder}/image/compiled"
        for one in pod.container.get("env") or []:
            source = one["valueFrom"]["secretKeyRef"]
            names[one["name"]] = base64.b64decode(self.secrets[source["name"]][source["key"]]).decode()
        return names

    def start(self, pod: Pod) -> None:
        """Start the container as a kubelet would, in its own mount namespace."""
        lines = [f"mount --types tmpfs none {shlex.quote(str(path))}" for path in self.hidden]
        for path, target in self.mounts(pod):
            # The root of this machine stays as it is: a path that it lacks is one of the node's folders.
            there = Path(target) if Path(target).is_dir() else self.folder / "root" / target.lstrip("/")
            there.mkdir(parents=True, exist_ok=True)
            lines.insert(0, f"mount --bind {shlex.quote(str(path))} {shlex.quote(str(there))}")
            if target == pod.container["workingDir"]:
                lines.append(f"cd {shlex.quote(str(there))}")
        lines.append('exec "$@"')
        words = [*UNSHARE, "sh", "-ec", "\n".join(lines), "sh"]
        words += [*pod.container["command"], *pod.container["args"]]
        with open(self.folder / "logs" / pod.name, "wb") as log:
            streams = {"stdin": subprocess.DEVNULL, "stdout": log, "stderr": log}
            pod.process = start(*words, folder=None, env=self.environment(pod), **streams)

    def run(self) -> None:
        """Run what waits, one after the other, until there is a None."""
        while (pod := self.waiting.get()) is not None:
            fate = self.fate(pod)
            if fate == "lost":
                pod.lost = True
                continue
            if pod.name not in self.pods:
                continue
            self.start(pod)
            if fate == "killed":
                self.end(pod)
            code = pod.process.wait()
            pod.exit_code = 128 - code if code < 0 else code
            shutil.rmtree(self.folder / "empty" / pod.name, ignore_errors=True)

    def end(self, pod: Pod) -> None:
        """Kill what a pod runs."""
        if pod.process is not None and pod.process.poll() is None:
            os.killpg(pod.process.pid, signal.SIGKILL)

    def describe_job(self, pod: Pod) -> dict[str, Any]:
        """The job as the API server tells of it."""
        if pod.lost or pod.exit_code:
            status = {"failed": 1}
        else:
            status = {"active": 1} if pod.exit_code is None else {"succeeded": 1}
        return {**pod.body, "apiVersion": "batch/v1", "kind": "Job", "status": status}

    def describe_pod(self, pod: Pod) -> dict[str, Any]:
        """The pod as the API server tells of it."""
        state: dict[str, Any] = {"waiting": {"reason": "ContainerCreating"}}
        if pod.process is not None:
            state = {"running": {}}
        if pod.exit_code is not None:
            state = {"terminated": {"exitCode": pod.exit_code}}
        status = {"name": "snakemake", "image": IMAGE, "imageID": IMAGE}
        status |= {"ready": "running" in state, "restartCount": 0, "state": state}
        return {
            "metadata": {"name": f"{pod.name}-x", "labels": {"job-name": pod.name}},
            "spec": pod.body["spec"]["template"]["spec"],
            "status": {"containerStatuses": [status]},
        }

    # What the API server answers: status and content by method and path.

    def answer(self, method: str, path: str, query: dict[str, str], body: Any) -> tuple[int, Any]:
        """Answer one request."""
        for pattern, name in ENDPOINTS.items():
            if match := re.fullmatch(pattern, f"{method} {path}"):
                self.calls.add(name)
                return getattr(self, name)(*match.groups(), query, body)
        return refuse(404, "NotFound", f"the stand-in has no {method} {path}")

    def create_secret(self, query: dict[str, str], body: Any) -> tuple[int, Any]:
        self.secrets[body["metadata"]["name"]] = body.get("data") or {}
        return 201, body

    def delete_secret(self, name: str, query: dict[str, str], body: Any) -> tuple[int, Any]:
        if self.secrets.pop(name, None) is None:
            return refuse(404, "NotFound", f'secrets "{name}" not found')
        return 200, {"status": "Success"}

    def create_job(self, query: dict[str, str], body: Any) -> tuple[int, Any]:
        pod = Pod(body)
        if pod.name in self.pods:
            return refuse(409, "AlreadyExists", f'jobs.batch "{pod.name}" already exists')
        if pod.container["image"] != IMAGE:
            return refuse(422, "Invalid", f"no image {pod.container['image']}")
        self.pods[pod.name] = pod
        self.submitted.append(pod)
        self.waiting.put(pod)
        return 201, self.describe_job(pod)

    def read_job(self, name: str, query: dict[str, str], body: Any) -> tuple[int, Any]:
        if name not in self.pods:
            return refuse(404, "NotFound", f'jobs.batch "{name}" not found')
        return 200, self.describe_job(self.pods[name])

    def delete_job(self, name: str, query: dict[str, str], body: Any) -> tuple[int, Any]:
        if (pod := self.pods.pop(name, None)) is None:
            return refuse(404, "NotFound", f'jobs.batch "{name}" not found')
        self.end(pod)
        return 200, {"status": "Success"}

    def list_pods(self, query: dict[str, str], body: Any) -> tuple[int, Any]:
        name = query["labelSelector"].removeprefix("job-name=")
        found = [pod for pod in self.pods.values() if pod.name == name and not pod.lost]
        items = [self.describe_pod(pod) for pod in found]
        return 200, {"apiVersion": "v1", "kind": "PodList", "items": items}

    def delete_pod(self, name: str, query: dict[str, str], body: Any) -> tuple[int, Any]:
        if (pod := self.pods.get(name.removesuffix("-x"))) is None:
            return refuse(404, "NotFound", f'pods "{name}" not found')
        self.end(pod)
        return 200, self.describe_pod(pod)

    def read_log(self, name: str, query: dict[str, str], body: Any) -> tuple[int, Any]:
        if query.get("previous", "").lower() == "true":
            # A kubelet keeps a previous container of those that it started anew, and no pod here restarts.
            container = query["container"]
            text = f'previous terminated container "{container}" in pod "{name}" not found'
            return refuse(400, "BadRequest", text)
        return 200, (self.folder / "logs" / name.removesuffix("-x")).read_text()


CORE, BATCH = r"/api/v1/namespaces/default", r"/apis/batch/v1/namespaces/default"
ENDPOINTS = {
    f"POST {CORE}/secrets": "create_secret",
    f"DELETE {CORE}/secrets/([^/]+)": "delete_secret",
    f"POST {BATCH}/jobs": "create_job",
    f"GET {BATCH}/jobs/([^/]+)/status": "read_job",
    f"DELETE {BATCH}/jobs/([^/]+)": "delete_job",
    f"GET {CORE}/pods": "list_pods",
    f"DELETE {CORE}/pods/([^/]+)": "delete_pod",
    f"GET {CORE}/pods/([^/]+)/log": "read_log",
}


def refuse(code: int, reason: str, message: str) -> tuple[int, Any]:
    """What the API server says of a request that it refuses."""
    content = {"kind": "Status", "apiVersion": "v1", "status": "Failure"}
    return code, {**content, "code": code, "reason": reason, "message": message}


def make_handler(cluster: Cluster) -> type[BaseHTTPRequestHandler]:
    """Handler of requests to a cluster."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def handle_one(self) -> None:
            asked = urlsplit(self.path)
            sent = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            query = {name: values[0] for name, values in parse_qs(asked.query).items()}
            code, content = cluster.answer(
                self.command, asked.path, query, json.loads(sent) if sent else None
            )
            kind, told = ("text/plain", content) if isinstance(content, str) else ("application/json", None)
            data = (told if told is not None else json.dumps(content)).encode()
            self.send_response(code)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        do_GET = do_POST = do_DELETE = handle_one

        def log_message(self, format: str, *args: Any) -> None:
            """Say nothing."""

    return Handler


def write_image(folder: Path) -> None:
    """Write the image's programs: this Python, and a pip that refuses all but what the image holds."""
    programs = folder / "image" / "bin"
    programs.mkdir(parents=True)
    lines = {
        "python": f'exec {shlex.quote(sys.executable)} "$@"',
        "pip": '[ "$1 $2 $4" = "install --target snakemake-storage-plugin-fs" ] && exit 0\n'
        'echo "pip: no network here: $*" >&2; exit 1',
    }
    for name, line in lines.items():
        (programs / name).write_text(f"#!/bin/sh\n{line}\n")
        (programs / name).chmod(0o755)


def write_kubeconfig(path: Path, port: int) -> Path:
    """Write what tells a client where the API server is."""
    one = {"cluster": "stand-in", "user": "tester"}
    content = {
        "apiVersion": "v1",
        "kind": "Config",
        "clusters": [{"name": "stand-in", "cluster": {"server": f"http://127.0.0.1:{port}"}}],
        "users": [{"name": "tester", "user": {"token": "none"}}],
        "contexts": [{"name": "stand-in", "context": one}],
        "current-context": "stand-in",
    }
    path.write_text(json.dumps(content))
    return path


@contextmanager
def start_cluster(
    folder: Path, hidden: list[Path], claims: list[str]
) -> Iterator[tuple[Cluster, dict[str, str]]]:
    """Run a stand-in; yields it and the environment in which a client finds it."""
    tried = call(*UNSHARE, "true")
    if tried.returncode:
        raise NoStandIn(
            f"pods need mount namespaces of their own, and there are none: {tried.stderr.strip()}"
        )
    cluster = Cluster(folder, hidden)
    for path in (folder / "logs", folder / "empty", *map(cluster.claim, claims)):
        path.mkdir(parents=True)
    write_image(folder)
    server = ThreadingHTTPServer(("127.0.0.1", 0), make_handler(cluster))
    threads = [threading.Thread(target=one, daemon=True) for one in (server.serve_forever, cluster.run)]
    for thread in threads:
        thread.start()
    file = write_kubeconfig(folder / "kubeconfig", server.server_port)
    try:
        cluster.client = {**os.environ, "KUBECONFIG": str(file), "NO_PROXY": "127.0.0.1"}
        yield cluster
    finally:
        for pod in cluster.submitted:
            cluster.end(pod)
        cluster.waiting.put(None)
        server.shutdown()
        server.server_close()
