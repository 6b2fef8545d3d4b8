"""What went wrong at a store: every library has exceptions of its own, which are told apart by
names, codes and numbers."""

import errno
from collections.abc import Iterator, Mapping

AGAIN = "check the network and the endpoint, then rerun the same command to resume"
GONE = "there is no such bucket or repository: make it first, or name another"
LOCAL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.ENOTCONN, errno.ESTALE, errno.EIO)
_PASSING = (errno.EBUSY, getattr(errno, "EREMOTEIO", errno.EIO))
_LOST = {
    "ConnectionError",
    "TimeoutError",
    "HTTPClientError",
    "ClientConnectionError",
    "ClientPayloadError",
    "TransportError",
}
_ANONYMOUS = {
    "NoCredentialsError",
    "PartialCredentialsError",
    "CredentialRetrievalError",
    "DefaultCredentialsError",
}
_EXPIRED = {
    "ExpiredToken",
    "ExpiredTokenException",
    "RequestExpired",
    "TokenRefreshRequired",
    "UnauthorizedSSOTokenError",
} | {*("TokenRetrievalError", "SSOTokenLoadError", "RefreshError", "InvalidToken")}
_WRONG = {"InvalidAccessKeyId", "SignatureDoesNotMatch", "401", "LocalTokenNotFoundError"}
THERE = {"PreconditionFailed", "ConditionalRequestConflict", "412"}
ABSENT = {"NoSuchBucket", "RepositoryNotFoundError", "RevisionNotFoundError"}


def chain(error: BaseException | None) -> Iterator[BaseException]:
    """An error, and those that it was raised from or while they were handled."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def names_of(error: BaseException) -> set[str]:
    """Names of the classes of an error and of what caused it, and codes that servers gave it."""
    found = set[str]()
    for each in chain(error):
        found |= {kind.__name__ for kind in type(each).__mro__}
        if str(each).startswith("Forbidden"):  # gcsfs says so in words only
            found.add("403")
        response = getattr(each, "response", None)
        if isinstance(response, Mapping):
            found.add(str(response.get("Error", {}).get("Code")))
        status = getattr(response, "status_code", getattr(each, "code", None))
        found |= {str(status)} - {"None"}
    return found


def passes(error: BaseException) -> bool:
    """Whether the same request may succeed a moment later."""
    busy = isinstance(error, OSError) and error.errno in _PASSING
    return busy or bool(names_of(error) & _LOST)


def why(error: BaseException) -> str:
    """One line on an error that is none of this machine's disk, with the fix."""
    names = names_of(error)
    for known, said in (
        (_EXPIRED, "the credential has expired: renew it, then rerun the same command to resume"),
        (
            _ANONYMOUS,
            "there are no credentials for it: set them as its library wants them (docs/storage.md)",
        ),
        (_WRONG, "the credential is not accepted: check it, then rerun the same command to resume"),
        (ABSENT, GONE),
        (_LOST, f"the connection is lost or refused: {AGAIN}"),
        (
            {"PermissionError", "403"},
            "the credential has no permission: grant it, then rerun the same command to resume",
        ),
    ):
        if names & known:
            return f"{said} ({line_of(error)})"
    return line_of(error)


def line_of(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
