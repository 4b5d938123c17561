"""A loaded FMU for co-simulation, by ctypes: what ``check()`` and the tests drive."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from ...core.errors import GyrosparkError

__all__ = ["STATUS", "Slave"]

#: Names of the status codes of FMI 2 and 3, by number.
STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")

_Pointer, _Text, _Real = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_double
_LOG2 = ctypes.CFUNCTYPE(None, _Pointer, _Text, ctypes.c_int, _Text, _Text)
_LOG3 = ctypes.CFUNCTYPE(None, _Pointer, ctypes.c_int, _Text, _Text)


class _Calls(ctypes.Structure):
    """The callbacks of FMI 2.0."""

    _fields_ = (("log", _LOG2), *((name, _Pointer) for name in (
        "allocate", "free", "finished", "environment")))


class Slave:
    """One instance of an FMU for co-simulation.

    Parameters
    ----------
    library : path
        The shared library.
    token : str
        The guid or instantiationToken.
    version : int
        2 or 3.
    references : mapping of str to int
        Value references by name.

    Attributes
    ----------
    messages : list of str
        Messages of its logger.

    Raises
    ------
    GyrosparkError
        If it does not load or makes no instance, with its messages.
    """

    def __init__(self, library: Path, token: str, version: int,
                 references: Mapping[str, int]) -> None:
        """Load the library of an FMU, and make an instance.

        ``token`` is the GUID of its description, ``references`` the value references by names.
        """
        try:
            self._library = ctypes.CDLL(str(library))
        except OSError as error:
            raise GyrosparkError(f"The library of the FMU does not load: {error}.") from error
        self._version, self._references = version, references
        self.messages: list[str] = []
        state = "FMUstate" if version == 2 else "FMUState"
        self._state = {pattern: pattern.replace("*", state) for pattern in (
            "Get*", "Set*", "Free*", "Serialized*Size", "Serialize*")}
        self._state["read"] = "DeSerializeFMUstate" if version == 2 else "DeserializeFMUState"
        self._instance = self._instantiate(token.encode())
        if not self._instance:
            raise GyrosparkError(f"The FMU makes no instance: {' '.join(self.messages)}")

    def _instantiate(self, token: bytes) -> Any:
        """Return an instance of the FMU, NULL if it makes none; its messages are collected.

        The callbacks are attributes, for the library keeps their addresses.
        """
        if self._version == 2:
            self._log: Any = _LOG2(lambda _e, _n, _s, _c, text: self.messages.append(text.decode()))
            # result and argument types are declared: ctypes would pass addresses as 32-bit integers
            self._calls = _Calls(self._log)
            make = self._library.fmi2Instantiate
            make.restype, make.argtypes = _Pointer, [
                _Text, ctypes.c_int, _Text, _Text, _Pointer, ctypes.c_int, ctypes.c_int]
            # 1: co-simulation; no folder of resources, not visible, no logging
            return make(b"model", 1, token, b"", ctypes.byref(self._calls), 0, 0)
        self._log = _LOG3(lambda _e, _s, _c, text: self.messages.append(text.decode()))
        make = self._library.fmi3InstantiateCoSimulation
        flag = ctypes.c_bool
        make.restype, make.argtypes = _Pointer, [
            _Text, _Text, _Text, flag, flag, flag, flag, _Pointer, ctypes.c_size_t, _Pointer, _LOG3,
            _Pointer]
        # no folder of resources; not visible, no logging, no events, no early return; no
        # intermediate variables, no environment, no intermediate updates
        return make(b"model", token, None, False, False, False, False, None, 0, None, self._log,
                    None)

    def call(self, name: str, *arguments: Any) -> str:
        """Return the status of a function by name, without fmi2 or fmi3."""
        function = getattr(self._library, f"fmi{self._version}{name}")
        return STATUS[function(_Pointer(self._instance), *arguments)]

    def call_checked(self, name: str, *arguments: Any) -> None:
        """Call a function; raise ``GyrosparkError`` with its message unless it succeeds."""
        status = self.call(name, *arguments)
        if status != "OK":
            raise GyrosparkError(f"fmi{self._version}{name} of the FMU returns {status}: "
                                 f"{' '.join(self.messages[-1:])}")

    def start(self, values: Mapping[str, float] | None = None, time: float = 0.0) -> None:
        """Set values and initialise."""
        if values:
            self.set(values)
        # neither a tolerance nor a time of the end is defined
        if self._version == 2:
            self.call_checked("SetupExperiment", 0, _Real(0), _Real(time), 0, _Real(0))
            self.call_checked("EnterInitializationMode")
        else:
            flag = ctypes.c_bool(False)
            self.call_checked("EnterInitializationMode", flag, _Real(0), _Real(time), flag,
                              _Real(0))
        self.call_checked("ExitInitializationMode")

    def set(self, values: Mapping[str, float]) -> None:
        """Set variables by name."""
        arguments, _ = self._arguments([*values], [*values.values()])
        self.call_checked("SetReal" if self._version == 2 else "SetFloat64", *arguments)

    def get(self, names: Sequence[str]) -> list[float]:
        """Return variables by name."""
        arguments, values = self._arguments(names, [0.0] * len(names))
        # the call writes into the array ``values``, which is among its arguments
        self.call_checked("GetReal" if self._version == 2 else "GetFloat64", *arguments)
        return [*values]

    def _arguments(self, names: Sequence[str], numbers: Sequence[float]) -> tuple[list[Any], Any]:
        """Return the C arguments for values of variables, in FMI's order, and the array of the
        values.

        FMI 3 has the number of values as a further argument.
        """
        count = ctypes.c_size_t(len(names))
        array = (_Real * len(names))(*numbers)
        arguments: list[Any] = [
            (ctypes.c_uint32 * len(names))(*(self._references[name] for name in names)), count,
            array]
        return (arguments if self._version == 2 else [*arguments, count]), array

    def step(self, time: float, size: float) -> str:
        """Return the status of a communication step from ``time`` over ``size``, both in seconds.
        """
        # 1, True: no state from before this step will be restored
        if self._version == 2:
            return self.call("DoStep", _Real(time), _Real(size), 1)
        flags = [ctypes.byref(ctypes.c_bool()) for _ in range(3)]
        return self.call("DoStep", _Real(time), _Real(size), ctypes.c_bool(True), *flags,
                         ctypes.byref(_Real()))

    def keep(self) -> Any:
        """Return a copy of the state, for ``restore``, ``write`` and ``free``."""
        state = _Pointer()
        self.call_checked(self._state["Get*"], ctypes.byref(state))
        return state

    def restore(self, state: Any) -> None:
        """Go back to a state."""
        self.call_checked(self._state["Set*"], state)

    def free(self, state: Any) -> None:
        """Release the memory of a state."""
        self.call_checked(self._state["Free*"], ctypes.byref(state))

    def write(self, state: Any) -> bytes:
        """Return a state as bytes."""
        size = ctypes.c_size_t()
        self.call_checked(self._state["Serialized*Size"], state, ctypes.byref(size))
        content = ctypes.create_string_buffer(size.value)
        self.call_checked(self._state["Serialize*"], state, content, size)
        return content.raw

    def read(self, content: bytes) -> Any:
        """Return the state of bytes, which another instance may have written."""
        state = _Pointer()
        self.call_checked(self._state["read"], content, ctypes.c_size_t(len(content)),
                  ctypes.byref(state))
        return state

    def __enter__(self) -> Slave:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        function = getattr(self._library, f"fmi{self._version}FreeInstance")
        function.restype = None
        function(_Pointer(self._instance))
