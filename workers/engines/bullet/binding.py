"""Bullet's C interface, which PyBullet's shared library exports beside the Python module, for compiled code."""

from __future__ import annotations

import ctypes
import importlib.util
from typing import Any

import llvmlite.binding

from toppling.models.numba_alone import intrinsic, numba, types

_PATH = str(importlib.util.find_spec("pybullet").origin)  # type: ignore[union-attr]
LIBRARY = ctypes.CDLL(_PATH)
llvmlite.binding.load_library_permanently(_PATH)  # where compiled code, cached code too, finds its functions

_ADDRESS, _NUMBER, _INDEX = types.intp, types.float64, types.int32
_IN_C: dict[Any, Any] = {
    _ADDRESS: ctypes.c_ssize_t,
    _NUMBER: ctypes.c_double,
    _INDEX: ctypes.c_int32,
    types.void: None,
}


def _compiled(name: str, result: Any, *arguments: Any) -> Any:
    """A C function, for compiled code, or for the same code in a debugger."""
    if numba.core.config.DISABLE_JIT:
        function = LIBRARY[name]
        function.restype, function.argtypes = _IN_C[result], [_IN_C[each] for each in arguments]
        return function
    return types.ExternalFunction(name, result(*arguments))


submit = _compiled("b3SubmitClientCommandAndWaitStatus", _ADDRESS, _ADDRESS, _ADDRESS)
parameters = _compiled("b3InitPhysicsParamCommand", _ADDRESS, _ADDRESS)
set_step = _compiled("b3PhysicsParamSetTimeStep", _INDEX, _ADDRESS, _NUMBER)
set_near = _compiled("b3PhysicsParamSetContactBreakingThreshold", _INDEX, _ADDRESS, _NUMBER)
step_command = _compiled("b3InitStepSimulationCommand", _ADDRESS, _ADDRESS)
request_state = _compiled("b3RequestActualStateCommandInit", _ADDRESS, _ADDRESS, _INDEX)
get_state = _compiled("b3GetStatusActualState", _INDEX, _ADDRESS, *[_ADDRESS] * 7)
pose_command = _compiled("b3CreatePoseCommandInit", _ADDRESS, _ADDRESS, _INDEX)
set_place = _compiled("b3CreatePoseCommandSetBasePosition", _INDEX, _ADDRESS, _NUMBER, _NUMBER, _NUMBER)
set_attitude = _compiled(
    "b3CreatePoseCommandSetBaseOrientation", _INDEX, _ADDRESS, _NUMBER, _NUMBER, _NUMBER, _NUMBER
)
set_velocity = _compiled("b3CreatePoseCommandSetBaseLinearVelocity", _INDEX, _ADDRESS, _ADDRESS)
set_spin = _compiled("b3CreatePoseCommandSetBaseAngularVelocity", _INDEX, _ADDRESS, _ADDRESS)
collision_filter = _compiled("b3CollisionFilterCommandInit", _ADDRESS, _ADDRESS)
set_filter = _compiled("b3SetCollisionFilterGroupMask", _INDEX, _ADDRESS, _INDEX, _INDEX, _INDEX, _INDEX)
request_contacts = _compiled("b3InitRequestContactPointInformation", _ADDRESS, _ADDRESS)
get_contacts = _compiled("b3GetContactPointInformation", types.void, _ADDRESS, _ADDRESS)


@intrinsic
def _compiled_pointer(typing_context: Any, address: Any) -> Any:  # noqa: ARG001  (numba's signature)
    """An address as a pointer."""

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.voidptr(types.intp), code


def _python_pointer(address: int) -> ctypes.c_void_p:
    return ctypes.c_void_p(int(address))


pointer: Any = _python_pointer if numba.core.config.DISABLE_JIT else _compiled_pointer
"""An address as a pointer."""
