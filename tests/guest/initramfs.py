"""The first file system of the virtual machine: a shell, the kernel modules it needs, one script.

The archive is the "newc" cpio of the kernel's Documentation/driver-api/early-userspace
(buffer-format), gzipped; nothing is installed and no root is needed to build it.
"""

from __future__ import annotations

import gzip
import lzma
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

MODULES = (
    "virtio_pci",
    "9p",
    "9pnet_virtio",
    "overlay",
    "xhci-pci",
    "libcomposite",
    "usb_f_fs",
    "dummy_hcd",
)
DIRECTORIES = ("dev", "proc", "sys", "modules", "host", "memory", "root")
REGULAR, DIRECTORY = 0o100755, 0o040755
# insmod finds no dependencies, but the names are numbered in their order. libusb hears of devices
# that are plugged in from udev.
INIT = """#!/busybox sh
B=/busybox
$B mount -t proc proc /proc
$B mount -t sysfs sys /sys
$B mount -t devtmpfs dev /dev
for module in /modules/*; do $B insmod $module; done
$B mount -t 9p -o trans=virtio,version=9p2000.L,cache=loose,ro,msize=262144 host /host
$B mount -t tmpfs memory /memory
$B mkdir /memory/upper /memory/work
$B mount -t overlay -o lowerdir=/host,upperdir=/memory/upper,workdir=/memory/work root /root
for tree in dev proc sys; do $B mount -o rbind /$tree /root/$tree; done
$B mount -t tmpfs run /root/run
$B mount -t configfs config /root/sys/kernel/config
$B ip link set lo up
$B mount -t 9p -o trans=virtio,version=9p2000.L,msize=262144 exchange /root/mnt
$B chroot /root /lib/systemd/systemd-udevd --daemon
$B chroot /root /bin/sh /mnt/command > /root/mnt/log 2>&1
echo $? > /root/mnt/status
$B sync
$B poweroff -f
"""


def build(release: str, busybox: Path) -> bytes:
    """A gzipped initramfs for the kernel `release`, whose modules are under /lib/modules."""
    entries = [(name, DIRECTORY, b"") for name in DIRECTORIES]
    entries += [("init", REGULAR, INIT.encode()), ("busybox", REGULAR, busybox.read_bytes())]
    for number, module in enumerate(_module_files(release)):
        name = f"modules/{number:02d}-{module.name.removesuffix('.xz')}"
        content = module.read_bytes()
        entries.append(
            (name, REGULAR, lzma.decompress(content) if module.suffix == ".xz" else content)
        )
    archive = b"".join(
        _entry(inode, *entry) for inode, entry in enumerate([*entries, ("TRAILER!!!", 0, b"")])
    )
    return gzip.compress(archive, compresslevel=1)


def _module_files(release: str) -> Iterator[Path]:
    """The wanted modules and what they depend on, each once, in the order of loading."""
    modprobe = shutil.which("modprobe", path="/usr/sbin:/sbin:/usr/bin")
    if modprobe is None:
        raise FileNotFoundError("modprobe (Debian package kmod)")
    command = [modprobe, "--set-version", release, "--show-depends", "--all", *MODULES]
    listing = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    files = [line.split()[1] for line in listing.splitlines() if line.startswith("insmod")]
    return map(Path, dict.fromkeys(files))


def _entry(inode: int, name: str, mode: int, content: bytes) -> bytes:
    path = name.encode() + b"\0"
    fields = (inode, mode, 0, 0, 1, 0, len(content), 0, 0, 0, 0, len(path), 0)
    header = b"070701" + b"".join(b"%08x" % field for field in fields)
    return _padded(header + path) + _padded(content)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
