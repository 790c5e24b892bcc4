"""Find the headless Chromium that browser tests drive, or install Debian's. Run as a program by `make test`."""

import shutil
import subprocess
import sys

CANDIDATES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def chromium_path() -> str | None:
    """Return the path of an installed Chromium or Chrome, or None."""
    return next((path for name in CANDIDATES if (path := shutil.which(name))), None)


def install() -> None:
    """Install Debian's Chromium; raises CalledProcessError where that is not possible."""
    sudo = [] if shutil.which("sudo") is None else ["sudo", "-n"]
    subprocess.run([*sudo, "apt-get", "update", "-qq"], check=True)
    subprocess.run([*sudo, "apt-get", "install", "-y", "-qq", "chromium"], check=True)


def main() -> int:
    """Make sure there is a browser; say what to do where there cannot be one."""
    if chromium_path() is None:
        try:
            install()
        except (subprocess.CalledProcessError, FileNotFoundError) as error:
            sys.stderr.write(
                f"Browser tests need Chromium or Chrome; installing it failed ({error}). Install it by hand.\n"
            )
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
