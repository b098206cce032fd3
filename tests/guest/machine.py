"""A small virtual machine with a real Linux USB stack, for machines whose own has no USB.

QEMU boots the installed Debian kernel in software. Its root is this machine's file system, read
only, under a layer in memory: the same Python, environment and checkout are there, and nothing
that happens inside stays. dummy_hcd joins a USB host and a USB device controller in memory, so
that a gadget written in user space is plugged into the kernel's own host stack.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from tests.guest import initramfs

MEMORY_MIB = 2048
# Who shields a kernel from its own programs empties the emulator's tables at every system call. The
# emulated time stamp counter is the host's, and read without asking a device.
KERNEL = "console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable"


@dataclass(frozen=True, slots=True)
class Parts:
    """What the virtual machine is made of."""

    qemu: Path
    kernel: Path
    release: str
    busybox: Path


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a command in the virtual machine ended; `status` is None if the machine hung."""

    status: int | None
    log: str


class PartsMissingError(Exception):
    """The virtual machine cannot be built here; the message says what to install."""


def find_parts() -> Parts:
    """Look for the emulator, a kernel with a simulated USB controller, and a static shell."""
    qemu, busybox = shutil.which("qemu-system-x86_64"), shutil.which("busybox")
    if qemu is None:
        raise PartsMissingError("no qemu-system-x86_64: apt install qemu-system-x86")
    if busybox is None:
        raise PartsMissingError("no busybox: apt install busybox-static")
    for kernel in sorted(Path("/boot").glob("vmlinuz-*"), reverse=True):
        release = kernel.name.removeprefix("vmlinuz-")
        controllers = Path("/lib/modules", release).rglob("dummy_hcd.ko*")
        if os.access(kernel, os.R_OK) and any(controllers):
            return Parts(Path(qemu), kernel, release, Path(busybox))
    raise PartsMissingError(
        "no readable kernel in /boot with the module dummy_hcd: apt install linux-image-amd64"
    )


def run(
    parts: Parts, command: list[str], exchange: Path, timeout_s: float, devices: list[str]
) -> Outcome:
    """Boot, run `command` as root in the current folder, power off.

    Parameters
    ----------
    parts
        What to boot.
    command
        Words of the command; it finds `exchange` at /mnt.
    exchange
        An empty folder that both sides can write to.
    timeout_s
        After which the machine is switched off.
    devices
        More arguments of QEMU, for example a USB device to plug in.
    """
    image = exchange / "initramfs"
    image.write_bytes(initramfs.build(parts.release, parts.busybox))
    environment = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    exports = [f"export {name}={shlex.quote(value)}" for name, value in environment.items()]
    script = [*exports, f"cd {shlex.quote(str(Path.cwd()))}", shlex.join(command)]
    (exchange / "command").write_text("\n".join(script) + "\n")
    machine = [str(parts.qemu), *_hardware(exchange), *devices]
    machine += ["-kernel", str(parts.kernel), "-initrd", str(image)]
    machine += ["-append", KERNEL]
    status = None
    try:
        subprocess.run(machine, stdin=subprocess.DEVNULL, timeout=timeout_s, check=True)
        status = int((exchange / "status").read_text())
    except subprocess.TimeoutExpired:
        pass
    logs = [exchange / "log", *([] if status is not None else [exchange / "console"])]
    return Outcome(status, "".join(log.read_text(errors="replace") for log in logs if log.exists()))


def _hardware(exchange: Path) -> list[str]:
    """One processor, memory, no network, and two shared folders: the root and the exchange.

    What runs inside takes turns anyway, and processors that are emulated side by side wait for each
    other more than they do.
    """
    shares = (
        ("host", "path=/,security_model=passthrough,readonly=on,multidevs=remap"),
        ("exchange", f"path={exchange},security_model=none"),
    )
    # A processor without AVX: emulated, NumPy's argsort has ended in a segmentation fault.
    words = ["-accel", "tcg", "-cpu", "Nehalem", "-smp", "1", "-m", str(MEMORY_MIB)]
    words += ["-display", "none", "-monitor", "none", "-no-reboot", "-net", "none"]
    words += ["-serial", f"file:{exchange}/console"]
    for tag, options in shares:
        words += ["-fsdev", f"local,id={tag},{options}"]
        words += ["-device", f"virtio-9p-pci,fsdev={tag},mount_tag={tag}"]
    return words
