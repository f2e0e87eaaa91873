"""What isolation needs of Linux and has no command: network, forbidden system calls."""

import ctypes
import errno
import fcntl
import mmap
import os
import socket
import struct
from typing import Any, List

_CLONE_NEWNET = 0x40000000
_CLONE_NEWUSER = 0x10000000
_LOCKS = {**dict.fromkeys((6, 7, 37, 38), 0), **dict.fromkeys((5, 36, 1026), errno.ENOLCK)}
"""All commands of fcntl(2) that see what other processes do, and the error that a node gets.

0 for F_SETLK to F_OFD_SETLKW, which then do nothing. F_GETLK, F_OFD_GETLK and F_NOTIFY fail.
"""

_NAMESPACES = tuple(1 << bit for bit in (17, *range(25, 31)))
"""All flags CLONE_NEW... of clone(2)."""

_CACHESTAT = 451
_SIOCSIFFLAGS = 0x8914
_IFF_UP = 1

FORBIDDEN = {
    errno.EPERM: (
        *("add_key", "keyctl", "request_key"),  # keys outlive a replay
        *("process_vm_readv", "process_vm_writev", "ptrace"),  # other processes
        *("mount", "setns", "unshare"),
        *("bpf", "perf_event_open", "userfaultfd"),  # often had faults
    ),
    # Programs use something else if the kernel does not have these.
    errno.ENOSYS: (
        "clone3",  # its flags are in memory, where a filter cannot read them
        "io_uring_setup",  # opens sockets past the filter
        *("fanotify_init", "inotify_init", "inotify_init1"),  # what other processes do with a file
        *("memfd_create", "shmget"),  # memory that belongs to no process
        # Which pages of a file are in memory, as another node has left them.
        *("cachestat", "fadvise64", "mincore", "preadv2", "readahead"),
    ),
}
"""The system calls that a node may not use, and the error that it gets."""


def make_filter(has_locks: bool) -> Any:
    """Return the filter of system calls for nodes, a seccomp.SyscallFilter.

    Without `has_locks`, locks on files have no effect, because another node would see them on a
    file of the system; catkin needs them to build a package. The filter forbids new namespaces;
    sockets other than those of Unix, IP and netlink, such as AF_VSOCK, which reaches the host of a
    virtual machine; and shared memory without a file, which the limit on the data of a process does
    not count.
    """
    import seccomp  # python3-seccomp, which only the isolation of submissions needs

    made = seccomp.SyscallFilter(seccomp.ALLOW)
    for error, names in FORBIDDEN.items():
        for name in names:
            made.add_rule(seccomp.ERRNO(error), number_of(name))
    if not has_locks:
        made.add_rule(seccomp.ERRNO(0), "flock")
    for command, error in {} if has_locks else _LOCKS.items():
        given = seccomp.Arg(1, seccomp.EQ, command)
        made.add_rule(seccomp.ERRNO(error), "fcntl", given)
    for flag in _NAMESPACES:
        given = seccomp.Arg(0, seccomp.MASKED_EQ, flag, flag)
        made.add_rule(seccomp.ERRNO(errno.EPERM), "clone", given)
    other = seccomp.Arg(0, seccomp.GT, socket.AF_NETLINK)
    made.add_rule(seccomp.ERRNO(errno.EAFNOSUPPORT), "socket", other)
    without_file = mmap.MAP_SHARED | mmap.MAP_ANONYMOUS
    shared = seccomp.Arg(3, seccomp.MASKED_EQ, without_file, without_file)
    made.add_rule(seccomp.ERRNO(errno.ENOMEM), "mmap", shared)
    return made


def number_of(name: str) -> int:
    """Return the number of a system call on this machine."""
    import seccomp

    if name == "cachestat":  # of Linux 6.5; the libseccomp of Debian 12 does not know it
        return _CACHESTAT
    return int(seccomp.resolve_syscall(seccomp.Arch(), name))


def enter_network() -> None:
    """Move this process, which must have one thread, into a network of its own.

    The network contains only the loopback interface. Without the right to do this, the process also
    gets a user namespace of its own, with the same users.

    Raises:
        OSError: the system refuses.
    """
    try:
        _call(_libc().unshare(_CLONE_NEWNET), "a new network")
    except PermissionError:
        _enter_user_namespace()
    with socket.socket() as loopback:
        fcntl.ioctl(loopback, _SIOCSIFFLAGS, struct.pack("16sh", b"lo", _IFF_UP))


def _enter_user_namespace() -> None:
    """Enter new namespaces for users and network; raise OSError if the system refuses."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:  # only a process outside of the new namespace may map several users
        try:
            os.close(writer)
            os.read(reader, 1)  # until this end of the pipe is closed
            _map_users(os.getppid())
            os._exit(0)
        finally:
            os._exit(1)
    result = _libc().unshare(_CLONE_NEWUSER | _CLONE_NEWNET)
    error = ctypes.get_errno()
    os.close(writer)
    os.close(reader)
    status = os.waitpid(child, 0)[1]
    ctypes.set_errno(error)
    _call(result, "a new user namespace")
    if status:
        raise PermissionError(errno.EPERM, "users cannot be mapped")


def _map_users(process: int) -> None:
    """Map each user that this process may use to itself, for another process."""
    for kind, own in (("uid", os.geteuid()), ("gid", os.getegid())):
        with open(f"/proc/self/{kind}_map", encoding="ascii") as file:
            known = [line.split() for line in file]
        lines: List[str] = [f"{first} {first} {count}" for first, _, count in known]
        if os.geteuid() != 0:
            lines = [f"{own} {own} 1"]
            with open(f"/proc/{process}/setgroups", "w", encoding="ascii") as file:
                file.write("deny")
        with open(f"/proc/{process}/{kind}_map", "w", encoding="ascii") as file:
            file.write("\n".join(lines))


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _call(result: int, what: str) -> None:
    """Raise OSError if a function of the C library returned -1."""
    if result == -1:
        raise OSError(ctypes.get_errno(), f"{what}: {os.strerror(ctypes.get_errno())}")
