"""What a disk, a mount or a permission refuses, in one line with the fix."""

import errno

_KEPT = "what is finished is kept, and the same command goes on"
_MOUNT = f"the mount is gone or broken: mount it again; {_KEPT}"
FIXES = {
    errno.ENOSPC: f"free some space; {_KEPT}",
    errno.EDQUOT: f"free some space or raise the quota; {_KEPT}",
    errno.EACCES: f"give this user the permission; {_KEPT}",
    errno.EPERM: f"give this user the permission; {_KEPT}",
    errno.EROFS: f"make it writable; {_KEPT}",
    **dict.fromkeys((errno.EIO, errno.ENODEV, errno.ENOTCONN, errno.ENXIO, errno.ESTALE, errno.EHOSTDOWN, errno.EREMOTEIO), _MOUNT),
}
"""What to do about an error, by its number."""


def said_of(error: OSError) -> str:
    """One line: the file, what is wrong with it, and the fix where there is one."""
    where = f"{error.filename}: " if error.filename else ""
    fix = FIXES.get(error.errno or 0)
    return where + " ".join((error.strerror or str(error)).split()) + (f": {fix}" if fix else "")
