"""Installs the PyTorch of constraints.txt into the Python that runs this; on Linux in a CPU build if possible.

On Linux, PyPI's wheel brings CUDA, cuDNN and NCCL along, 2.7 GB together; on macOS and Windows it is a build for the
CPU. So on Linux PyTorch's own index of CPU builds is asked first. If it cannot be reached, pip decides. Needs only the
standard library and pip, because it runs before anything is installed.
"""

import socket
import subprocess
import sys
import threading
from pathlib import Path
from urllib.request import getproxies

CPU_INDEX = "https://download.pytorch.org/whl/cpu"
HOST = "download.pytorch.org"
TIMEOUT_S = 5.0
CONSTRAINTS = Path(__file__).parents[1] / "constraints.txt"


def main() -> int:
    """Install it; return pip's exit code."""
    wanted = pinned_torch()
    if sys.platform == "linux" and is_index_reachable():
        _pip(
            "--retries", "1", "--timeout", f"{TIMEOUT_S:.0f}", "install", "--no-deps", "--index-url", CPU_INDEX, wanted
        )
    elif sys.platform == "linux":
        sys.stderr.write(f"{CPU_INDEX} cannot be reached, so pip chooses the build of {wanted}; it may bring CUDA.\n")
    # With the wheel in place this installs only its dependencies.
    return _pip("install", "--constraint", str(CONSTRAINTS), wanted)


def pinned_torch() -> str:
    """Return the requirement of constraints.txt, such as torch==2.13.0."""
    lines = CONSTRAINTS.read_text(encoding="utf-8").splitlines()
    return next(line for line in lines if line.startswith("torch=="))


def is_index_reachable() -> bool:
    """Tell within 5 s whether PyTorch's index answers; behind a proxy that is for pip to find out.

    A resolver without a network may take longer than any timeout of a socket, so it is asked in a thread that is left.
    """
    if getproxies():
        return True
    answered = threading.Event()

    def connect() -> None:
        try:
            socket.create_connection((HOST, 443), timeout=TIMEOUT_S).close()
        except OSError:
            return
        answered.set()

    asking = threading.Thread(target=connect, daemon=True)
    asking.start()
    asking.join(TIMEOUT_S)
    return answered.is_set()


def _pip(*arguments: str) -> int:
    return subprocess.run([sys.executable, "-m", "pip", "--quiet", *arguments]).returncode


if __name__ == "__main__":
    sys.exit(main())
