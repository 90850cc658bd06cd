"""What etalon raises: what a caller cannot go on from. The same hierarchy as in C++ (core/program/errors.h).

A marker that is not found, or a camera out of its limits, is a result and no exception.
"""


class Error(RuntimeError):
    """Base of all errors that etalon raises on purpose."""


class ConfigError(Error, ValueError):
    """An input that cannot be used: a file, a key in it, or an argument.

    file: path as it was given, or the argument's name; line: from 1, 0 where there are none;
    key: dotted path of the value, empty for all of the file.
    """

    def __init__(self, message, file="", line=0, key=""):
        super().__init__(message)
        self.file, self.line, self.key = file, line, key


class DeviceError(Error):
    """A device that did not do what was asked of it: device, request and cause in words."""

    def __init__(self, message, device="", request="", cause=""):
        super().__init__(message)
        self.device, self.request, self.cause = device, request, cause


class NumericalError(Error, ArithmeticError):
    """A computation without a trustworthy result; the message has the values that tell why."""


class Interrupted(Error):
    """Stopped on request."""
