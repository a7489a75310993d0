"""Exit codes of the command line, one for each kind of ending, and the refusal of a command line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from torchsphere.results.atomic_output import FULL
from torchsphere.runtime.setting_names import as_options
from torchsphere.settings.limits import SettingError

#: 0: all is written and measured. 1: an input or an output folder cannot be used. 2: the command line or a file of
#: settings cannot be used. 3: some of many inputs failed, the rest is done. 4: the result is written, and nothing
#: usable was measured. 130: Ctrl-C.
DONE, BAD_INPUT, BAD_COMMAND, SOME_FAILED, UNUSABLE, INTERRUPTED = 0, 1, 2, 3, 4, 130


class UsageError(ValueError):
    """A command line or a file of settings that cannot be used, in one sentence; exit code 2."""


@contextlib.contextmanager
def usage() -> Iterator[None]:
    """Turn every refusal of a value into a `UsageError`; errors of the system stay as they are."""
    try:
        yield
    except SettingError as error:
        raise UsageError(error.as_options()) from error
    except ValueError as error:
        raise UsageError(as_options(str(error))) from error


def sentence(error: Exception) -> str:
    """The error in one line, with settings named as options, and with advice on errors of the system."""
    if isinstance(error, SettingError):
        return error.as_options()
    if isinstance(error, OSError) and error.strerror is not None:
        remedy = "make room" if error.errno in FULL else "check the name and the permissions"
        return f"{error.filename or 'file'}: {error.strerror.lower()}; {remedy}"
    return as_options(" ".join(str(error).split()))
