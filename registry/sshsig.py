"""Signatures as ``ssh-keygen -Y sign`` makes them (OpenSSH, PROTOCOL.sshsig): made, read and verified.

Verified in this process where the package ``cryptography`` is installed, which takes 0.2 ms; else by ``ssh-keygen``,
which takes 6 ms.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import os
import re
import struct
import subprocess
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from calibrary.errors import RegistryError

KEY: Final = re.compile(r"(?:sk-)?(?:ssh|ecdsa)-\S+ \S+")
"""The text of a public key: its kind and its content."""
ARMOR: Final = "-----BEGIN SSH SIGNATURE-----\n"
END: Final = "\n-----END SSH SIGNATURE-----\n"
MAGIC: Final = b"SSHSIG\0\0\0\1"
HASHES: Final = {b"sha512": hashlib.sha512, b"sha256": hashlib.sha256}
SHORTEST_RSA: Final = 2048
TOUCHED: Final = 1
"""Flag of a security key that somebody touched; ssh-keygen accepts a signature without."""


class BadSignatureError(ValueError):
    """A signature that is not one, or is not of these bytes."""


def key_blob(text: str) -> bytes | None:
    """Return the content of a public key; None if the text is not one."""
    if KEY.match(text) is None:
        return None
    kind, encoded = text.split()[:2]
    try:
        blob = base64.b64decode(encoded, validate=True)
        name, _ = _taken(blob, 0)
    except (binascii.Error, BadSignatureError):
        return None
    return blob if name == kind.encode() else None


def fingerprint(blob: bytes) -> str:
    """Return the fingerprint of a key, as ssh-keygen prints it."""
    return "SHA256:" + base64.b64encode(hashlib.sha256(blob).digest()).decode().rstrip("=")


def signed_by(data: bytes, armored: str, namespace: str) -> bytes:
    """Return the key of a good signature.

    Raises:
        BadSignatureError: it is not a signature of these bytes for this purpose, or by a key of an unknown kind.
    """
    if not (armored.startswith(ARMOR) and armored.endswith(END)):
        raise BadSignatureError("not in the form of ssh-keygen")
    try:
        raw = base64.b64decode(armored[len(ARMOR) : -len(END)].replace("\n", ""), validate=True)
    except binascii.Error:
        raise BadSignatureError("not base64") from None
    if not raw.startswith(MAGIC):
        raise BadSignatureError("not an SSH signature")
    key, at = _taken(raw, len(MAGIC))
    purpose, at = _taken(raw, at)
    reserved, at = _taken(raw, at)
    name, at = _taken(raw, at)
    signature, at = _taken(raw, at)
    if at != len(raw) or purpose != namespace.encode() or name not in HASHES:
        raise BadSignatureError(f"not made for {namespace}")
    hashed = b"".join(map(_framed, (purpose, reserved, name, HASHES[name](data).digest())))
    message = b"SSHSIG" + hashed
    kind, _ = _taken(key, 0)
    if kind.startswith(b"sk-"):
        _require_touch(signature)
    try:
        _verify_here(key, kind, signature, message)
    except ImportError:
        _verify_outside(key, data, armored, namespace)
    return key


def _taken(data: bytes, at: int) -> tuple[bytes, int]:
    if at + 4 > len(data):
        raise BadSignatureError("cut off")
    (length,) = struct.unpack_from(">I", data, at)
    if at + 4 + length > len(data):
        raise BadSignatureError("cut off")
    return data[at + 4 : at + 4 + length], at + 4 + length


def _framed(data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + data


def _require_touch(signature: bytes) -> None:
    _, at = _taken(signature, 0)
    _, at = _taken(signature, at)
    if at + 5 != len(signature) or not signature[at] & TOUCHED:
        raise BadSignatureError("of a security key that nobody touched")


@lru_cache(4096)
def _public(key: bytes) -> Any:
    from cryptography.exceptions import UnsupportedAlgorithm  # noqa: PLC0415  not everybody has it
    from cryptography.hazmat.primitives.asymmetric.ed25519 import (  # noqa: PLC0415  the same
        Ed25519PublicKey,
    )
    from cryptography.hazmat.primitives.serialization import load_ssh_public_key  # noqa: PLC0415  the same

    kind, at = _taken(key, 0)
    try:
        if kind in {b"ssh-ed25519", b"sk-ssh-ed25519@openssh.com"}:
            return Ed25519PublicKey.from_public_bytes(_taken(key, at)[0])
        return load_ssh_public_key(kind + b" " + base64.b64encode(key))
    except (ValueError, UnsupportedAlgorithm):
        raise BadSignatureError("by a key of an unknown kind") from None


def _verify_here(key: bytes, kind: bytes, signature: bytes, message: bytes) -> None:
    from cryptography.exceptions import InvalidSignature  # noqa: PLC0415  not everybody has it
    from cryptography.hazmat.primitives import hashes  # noqa: PLC0415  the same
    from cryptography.hazmat.primitives.asymmetric import ec, padding, utils  # noqa: PLC0415  the same

    public = _public(key)
    name, at = _taken(signature, 0)
    value, at = _taken(signature, at)
    is_whole = at == len(signature)
    try:
        if kind == b"ssh-ed25519" and name == kind and is_whole:
            public.verify(value, message)
        elif kind == b"ssh-rsa" and name in {b"rsa-sha2-512", b"rsa-sha2-256"} and is_whole:
            if public.key_size < SHORTEST_RSA:
                raise BadSignatureError(f"by an RSA key of less than {SHORTEST_RSA} bits")
            digest = hashes.SHA512() if name.endswith(b"512") else hashes.SHA256()
            public.verify(value, message, padding.PKCS1v15(), digest)
        elif kind.startswith(b"ecdsa-sha2-nistp") and name == kind and is_whole:
            r, at = _taken(value, 0)
            s, at = _taken(value, at)
            sizes = {256: hashes.SHA256(), 384: hashes.SHA384(), 521: hashes.SHA512()}
            encoded = utils.encode_dss_signature(int.from_bytes(r, "big"), int.from_bytes(s, "big"))
            public.verify(encoded, message, ec.ECDSA(sizes[public.curve.key_size]))
        elif kind == b"sk-ssh-ed25519@openssh.com" and name == kind:
            _, at_key = _taken(key, _taken(key, 0)[1])
            application, _ = _taken(key, at_key)
            answered = (
                hashlib.sha256(application).digest() + signature[at:] + hashlib.sha256(message).digest()
            )
            public.verify(value, answered)
        else:
            raise BadSignatureError("by a key of an unknown kind")
    except (InvalidSignature, ValueError) as error:
        raise error if isinstance(error, BadSignatureError) else BadSignatureError("wrong") from None


def _verify_outside(key: bytes, data: bytes, armored: str, namespace: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        kind, _ = _taken(key, 0)
        signers, file = Path(folder) / "signers", Path(folder) / "signature"
        signers.write_bytes(b"* " + kind + b" " + base64.b64encode(key) + b"\n")
        file.write_text(armored, "ascii")
        options = ("-f", str(signers), "-I", "anybody", "-n", namespace, "-s", str(file))
        done = _ssh_keygen("verify", *options, data=data)
    if done.returncode:
        raise BadSignatureError("wrong")


def _ssh_keygen(action: str, *options: str, data: bytes) -> subprocess.CompletedProcess[bytes]:
    command = ("ssh-keygen", "-Y", action, *options)
    try:
        return subprocess.run(command, input=data, capture_output=True, check=False)  # noqa: S603  a fixed program
    except OSError:
        raise RegistryError(
            "statements are signed and verified by ssh-keygen, which is not installed (OpenSSH); 'pip install "
            "cryptography' is enough to verify them"
        ) from None


class Signer:
    """The key that git signs with here, by ``user.signingkey``: a file, or the text of a public key in an agent.

    Attributes:
        blob: the public key; None if it cannot be told, with the reason in ``problem``.
    """

    def __init__(self, setting: str | None) -> None:
        self.blob: bytes | None = None
        self.problem: str | None = None
        text = (setting or "").strip().removeprefix("key::")
        self._file: Path | None = None
        if not text:
            self.problem = "git names no key: git config --global user.signingkey ~/.ssh/id_ed25519.pub"
            return
        self._text = text
        if not KEY.match(text):
            self._file = Path(text).expanduser()
            public = self._file if self._file.suffix == ".pub" else Path(f"{self._file}.pub")
            try:
                self._text = public.read_text("utf-8", "replace")
            except OSError as error:
                self.problem = (
                    f"user.signingkey is {text!r:.80}, and {public} cannot be read ({error.strerror}); statements are "
                    "signed with an ssh key"
                )
                return
        self.blob = key_blob(self._text)
        if self.blob is None:
            self.problem = f"user.signingkey is {text!r:.80}, which is no ssh key"

    def sign(self, data: bytes, namespace: str) -> str:
        """Return the armored signature.

        Raises:
            RegistryError: ssh-keygen cannot sign, with its reason.
        """
        with tempfile.TemporaryDirectory() as folder:
            file = self._file
            if file is None:
                file = Path(folder) / "key.pub"
                file.write_text(f"{self._text}\n", "utf-8")
            elif file.suffix == ".pub" and os.path.lexists(file.with_suffix("")):
                file = file.with_suffix("")
            done = _ssh_keygen("sign", "-q", "-n", namespace, "-f", str(file), data=data)
        if done.returncode:
            said = done.stderr.decode("utf-8", "replace").strip()
            raise RegistryError(f"nothing was written: ssh-keygen does not sign with {file}: {said}")
        armored = done.stdout.decode("ascii")
        signed_by(data, armored, namespace)
        return armored
