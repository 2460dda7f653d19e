"""The signature of a published root, made and verified by ssh-keygen (OpenSSH 8.1 or newer)."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

from calibrary.errors import RegistryError
from calibrary.registry.published.layout import NAMESPACE, ROOT_FILE, SIGNATURE_FILE

__all__ = ["reason_against", "sign"]


def sign(data: bytes, key: Path) -> bytes:
    """Sign a root.

    Raises:
        RegistryError: ssh-keygen is not installed, or cannot sign with this key.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / ROOT_FILE
        file.write_bytes(data)
        done = _ssh_keygen("sign", "-n", NAMESPACE, "-f", str(key), str(file))
        if done.returncode != 0:
            errors = done.stderr.decode("utf-8", "replace").strip().splitlines()
            raise RegistryError(
                f"{key}: ssh-keygen cannot sign with it: {errors[-1] if errors else 'no reason given'}"
            )
        return file.with_name(SIGNATURE_FILE).read_bytes()


def reason_against(data: bytes, signature: str, signers: Path) -> str | None:
    """Return why a signature of a root is not accepted; None if it is by an accepted signer.

    Args:
        data: the root.
        signature: signature in the form of :func:`sign`.
        signers: an "ALLOWED SIGNERS" file of ssh-keygen(1).

    Raises:
        RegistryError: ssh-keygen is not installed, or the file does not exist.
    """
    if not signers.is_file():
        raise RegistryError(f"{signers}: no such file, expected one of allowed signers, as of ssh-keygen(1)")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / SIGNATURE_FILE
        file.write_text(signature, encoding="utf-8")
        given = ("-s", str(file), "-f", str(signers))
        names = _ssh_keygen("find-principals", *given).stdout.decode("utf-8", "replace").splitlines()
        for name in (name.strip() for line in names for name in line.split(",")):
            if _ssh_keygen("verify", "-n", NAMESPACE, "-I", name, *given, data=data).returncode == 0:
                return None
    return f"is not signed by a key in {signers}"


def _ssh_keygen(action: str, *arguments: str, data: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    command = ["ssh-keygen", "-Y", action, *arguments]
    try:
        return subprocess.run(command, input=data, capture_output=True, check=False)  # noqa: S603  a fixed program
    except FileNotFoundError:
        raise RegistryError("ssh-keygen is not installed, and signatures need it") from None
