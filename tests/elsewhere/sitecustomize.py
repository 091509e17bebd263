"""Take away from archfrag what Windows does not have, in this process and in those it starts.

`pytest --as-elsewhere` puts this folder first in PYTHONPATH. Only modules of archfrag meet the
other system; pytest and other libraries go on as before. What it takes away:

- the modules fcntl, resource, pwd, grp and termios;
- of os: fork, getuid, killpg, mkfifo, O_NONBLOCK, O_NOFOLLOW, register_at_fork, set_blocking;
  `os.kill(pid, 0)`, which there is Ctrl+C, and the context "fork" of multiprocessing;
- signals but SIGINT, SIGTERM, SIGABRT and SIGSEGV, and timers;
- mode bits and owners of files;
- replacing or removing a file that this process has open, and renaming to a name that is there;
- names that differ in case only, names of devices, and characters that no name may have;
- the encoding UTF-8 and the line end "\\n" of text files that do not ask for them;
- slashes in `os.path.relpath`, in relative paths as text, and as the separator of paths.
"""

import builtins
import functools
import io
import multiprocessing
import os
import pathlib
import re
import signal
import stat
import sys
import types

GONE = {
    "os": "fork getuid geteuid killpg mkfifo O_NONBLOCK O_NOFOLLOW register_at_fork set_blocking "
    "statvfs uname sysconf getpgid setsid WNOHANG",
    "signal": "SIGHUP SIGKILL SIGPROF SIGALRM SIGUSR1 SIGUSR2 SIGCHLD SIGPIPE SIGQUIT setitimer "
    "ITIMER_PROF alarm pthread_sigmask",
}
MODULES = ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "syslog")
DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?")
_import = builtins.__import__
_open = io.open


def _is_ours(depth: int = 2) -> bool:
    """Return whether the caller's caller is a module of archfrag."""
    while True:
        name = sys._getframe(depth).f_globals.get("__name__") or ""
        if name not in ("pathlib", __name__):
            return name.partition(".")[0] in ("archfrag", "archfrag_of_test")
        depth += 1


def _is_open(path: "str | os.PathLike[str]") -> bool:
    """Return whether this process has a file open."""
    real = os.path.realpath(path)
    for each in os.listdir("/proc/self/fd"):
        try:
            if os.readlink(f"/proc/self/fd/{each}") == real:
                return True
        except OSError:
            continue
    return False


def _check_free(path: "str | os.PathLike[str]") -> None:
    if _is_open(path):
        raise PermissionError(13, "The process cannot access the file", str(path))


def _check_name(path: "str | os.PathLike[str]") -> None:
    """Raise OSError if Windows has no such name, or would take another file for it."""
    folder, name = os.path.split(os.path.realpath(path))
    if DEVICES.fullmatch(name) or re.search(r'[<>:"|?*\\]|[. ]$', name):
        raise OSError(22, "Invalid argument", str(path))
    try:
        names = os.listdir(folder)
    except OSError:
        return
    if name not in names and name.casefold() in map(str.casefold, names):
        raise OSError(
            22, "the name differs in case from that of another file", str(path)
        )


class Module(types.ModuleType):
    """A module without what is gone, and with other functions in place of some."""

    def __init__(self, module, gone, **others) -> None:
        super().__init__(module.__name__)
        self._module = module
        self._gone = gone.split()
        self.__dict__.update(others)

    def __getattr__(self, name):
        if name in self._gone:
            raise AttributeError(f"module {self.__name__!r} has no {name!r} elsewhere")
        return getattr(self._module, name)


def _replace(source, target, **options):
    _check_free(source)
    _check_free(target)
    _check_name(target)
    os.replace(source, target, **options)


def _rename(source, target, **options):
    if os.path.exists(target):
        raise FileExistsError(17, "File exists", str(target))
    _replace(source, target, **options)


def _unlink(path, **options):
    _check_free(path)
    os.unlink(path, **options)


def _kill(process, number):
    assert number != 0, "os.kill(pid, 0) sends Ctrl+C on Windows"
    os.kill(process, number)


def _relpath(*places):
    return os.path.relpath(*places).replace("/", "\\")


def _stat(function):
    def without_modes(*arguments, **options):
        found = function(*arguments, **options)
        kind = stat.S_IFMT(found.st_mode)
        values = list(found)
        values[0] = kind | 0o777 if stat.S_ISDIR(found.st_mode) else kind | 0o666
        values[4] = values[5] = 0
        extra = {"st_mtime": found.st_mtime, "st_mtime_ns": found.st_mtime_ns}
        return os.stat_result(values, extra)

    return without_modes


def _open_os(path, flags, *arguments, **options):
    if flags & os.O_CREAT:
        _check_name(path)
    return os.open(path, flags, *arguments, **options)


_TAKEN = {
    "os": Module(
        os,
        GONE["os"],
        replace=_replace,
        rename=_rename,
        unlink=_unlink,
        remove=_unlink,
        kill=_kill,
        open=_open_os,
        path=Module(os.path, "", relpath=_relpath),
        stat=_stat(os.stat),
        lstat=_stat(os.lstat),
        linesep="\r\n",
        sep="\\",
    ),
    "signal": Module(signal, GONE["signal"]),
}


def _imported(name, globals=None, locals=None, fromlist=(), level=0):
    caller = ((globals or {}).get("__name__") or "").partition(".")[0]
    if level == 0 and caller in ("archfrag", "archfrag_of_test"):
        if name in MODULES:
            raise ModuleNotFoundError(f"No module named {name!r} elsewhere")
        if name in _TAKEN:
            return _TAKEN[name]
    return _import(name, globals, locals, fromlist, level)


def _elsewhere_open(
    file, mode="r", buffering=-1, encoding=None, errors=None, newline=None, *rest
):
    if _is_ours():
        if "b" not in mode:
            encoding = encoding or "cp1252"
            if newline is None and set(mode) & set("wax+"):
                newline = "\r\n"
        if set(mode) & set("wax") and not isinstance(file, int):
            _check_name(file)
    return _open(file, mode, buffering, encoding, errors, newline, *rest)


def _patch_pathlib() -> None:
    path = pathlib.Path
    touch, mkdir, unlink, replace = path.touch, path.mkdir, path.unlink, path.replace
    read, write = path.read_text, path.write_text

    def open_(self, mode="r", buffering=-1, encoding=None, errors=None, newline=None):
        return _elsewhere_open(self, mode, buffering, encoding, errors, newline)

    def touched(self, *arguments, **options):
        if _is_ours():
            _check_name(self)
        return touch(self, *arguments, **options)

    def made(self, *arguments, **options):
        if _is_ours():
            _check_name(self)
        return mkdir(self, *arguments, **options)

    def unlinked(self, *arguments, **options):
        if _is_ours():
            _check_free(self)
        return unlink(self, *arguments, **options)

    def replaced(self, target):
        if _is_ours():
            _check_free(self)
            _check_free(target)
            _check_name(target)
        return replace(self, target)

    def read_text(self, encoding=None, errors=None):
        return read(self, encoding or ("cp1252" if _is_ours() else None), errors)

    def write_text(self, data, encoding=None, errors=None, newline=None):
        if _is_ours():
            _check_name(self)
            encoding = encoding or "cp1252"
            newline = "\r\n" if newline is None else newline
        return write(self, data, encoding, errors, newline)

    for each, name in (
        (open_, "open"),
        (touched, "touch"),
        (made, "mkdir"),
        (unlinked, "unlink"),
        (replaced, "replace"),
        (read_text, "read_text"),
        (write_text, "write_text"),
    ):
        setattr(path, name, functools.wraps(getattr(path, name))(each))

    relative = pathlib.PurePath.relative_to

    class WithBackslashes(pathlib.PosixPath):
        def __str__(self) -> str:
            return super().__str__().replace("/", "\\")

        def __fspath__(self) -> str:
            return super().__str__()

        def as_posix(self) -> str:
            return super().__str__()

    def relative_to(self, *other):
        found = relative(self, *other)
        return WithBackslashes(found) if _is_ours() else found

    pathlib.PurePath.relative_to = relative_to


def _context(name=None):
    if name == "fork" and _is_ours():
        raise ValueError("cannot find context for 'fork'")
    return _get_context(name)


_get_context = multiprocessing.get_context


def install() -> None:
    """Let modules of archfrag that are imported from now on meet the other system."""
    if builtins.__import__ is not _imported:
        builtins.__import__ = _imported
        builtins.open = _elsewhere_open
        multiprocessing.get_context = _context
        _patch_pathlib()


install()
