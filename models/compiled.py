"""How the inner loop is compiled, and where the code that comes of it is kept.

Numba keeps compiled code as files that the next process executes. They lie in a folder that only the user can write,
named by a hash of all they are made from and for, because Numba itself notices no change in a function called from
another file. Where no such folder can be had, every process compiles for itself.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding
import numpy as np

from toppling.models.alone import import_alone
from toppling.models.arrays import Array as Array
from toppling.models.arrays import Flags as Flags
from toppling.models.arrays import Indices as Indices
from toppling.models.files.folder import cache_folder

import_alone("numba", ".numba_config.yaml")

import numba  # noqa: E402
import numba.core.caching  # noqa: E402
import numba.core.imputils  # noqa: E402
import numba.extending  # noqa: E402
from numba.core import cgutils  # noqa: E402

numba.core.config._config_fname = (
    os.devnull
)  # otherwise that file is also read whenever something is compiled
numba.core.config._env_reloader.reset()  # of who had imported Numba before

Vector = tuple[float, float, float]

types: Any = numba.types

_SHIPPED_VARIABLE = "TOPPLING_COMPILED"
"""Names a folder of compiled code that an image brings along."""

_COMPILED_ROOMS = tuple(Path(__file__).parent.parent / room for room in ("models/ground", "workers"))
"""Whose code is compiled: what changes in them makes all of it anew."""


COMPLETE = "complete"
"""File that stands in a folder of compiled code when all that a shake needs is there."""


def _hash() -> str:
    digest = hashlib.blake2b(digest_size=8)
    for package in (numba, llvmlite, np):
        digest.update(package.__version__.encode())
    # The processor, or that of NUMBA_CPU_NAME and NUMBA_CPU_FEATURES.
    processor = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
    digest.update(repr(processor).encode() + Path(__file__).read_bytes())
    for room in _COMPILED_ROOMS:
        for path in sorted(room.rglob("*.py")):
            digest.update(bytes(path.relative_to(room)) + path.read_bytes())
    return digest.hexdigest()


def _private_folder(parent: Path) -> Path | None:
    """A folder for compiled code below a parent, or None if it cannot be written or others can write it."""
    folder = parent / f"compiled-{_hash()}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _only_writable_by(folder, os.getuid()) and os.access(folder, os.W_OK | os.X_OK):
            _take_shipped(folder)
            return folder
    return None


def _only_writable_by(folder: Path, *users: int) -> bool:
    found = folder.lstat()
    return found.st_uid in users and not found.st_mode & 0o022 and not folder.is_symlink()


def _take_shipped(folder: Path) -> None:
    """Copy what an image ships for this program and processor, unless it has been; only what root or we made."""
    shipped = os.environ.get(_SHIPPED_VARIABLE)
    if not shipped or (folder / COMPLETE).exists():
        return
    source = Path(shipped) / folder.name
    if (source / COMPLETE).exists() and all(
        _only_writable_by(path, 0, os.getuid()) for path in (source.parent, source)
    ):
        ignored = shutil.ignore_patterns(COMPLETE, "lock")
        shutil.copytree(source, folder, ignore=ignored, copy_function=_copy_whole, dirs_exist_ok=True)
        folder.chmod(0o700)
        (folder / COMPLETE).touch()


def _copy_whole(source: str, target: str) -> None:
    """Copy a file so that other processes see all of it or nothing."""
    part = f"{target}.{os.getpid()}"
    shutil.copyfile(source, part)
    Path(part).replace(target)


FOLDER = _private_folder(cache_folder())
"""Folder of the compiled code, or None."""


class _VerifiedFile(numba.core.caching.IndexDataCacheFile):
    """A file of compiled code that ends with its digest: what is executed is what was compiled, to the bit.

    One that does not have its digest is reported and not loaded, so that its function is compiled anew.
    """

    @contextlib.contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[io.BytesIO]:
        content = io.BytesIO()
        yield content
        with super()._open_for_write(filepath) as file:
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())

    def _load_index(self) -> dict:
        return super()._load_index() if self._is_whole(self._index_path) else {}

    def _load_data(self, name: str) -> Any:
        if not self._is_whole(self._data_path(name)):
            raise FileNotFoundError(name)  # which Numba takes for a reason to compile
        return super()._load_data(name)

    @staticmethod
    def _is_whole(path: str) -> bool:
        try:
            content = Path(path).read_bytes()
        except FileNotFoundError:
            return False
        if hashlib.sha256(content[:-32]).digest() == content[-32:]:
            return True
        sys.stderr.write(f"compiled code in {path} is damaged: compiled anew\n")
        return False


class _OfModule(numba.core.caching.UserWideCacheLocator):
    """Keeps a function's code in a folder that its module names: Numba's own is named by where its source lies.

    So a checkout, a wheel and an image's copy of one program compile once together.
    """

    def __init__(self, function: Callable[..., Any], file: str) -> None:
        super().__init__(function, file)
        self._cache_path = str(FOLDER / function.__module__) if FOLDER else ""


class _Implementation(numba.core.caching.CompileResultCacheImpl):
    _locator_classes = (_OfModule,)


class _Cache(numba.core.caching.FunctionCache):
    _impl_class = _Implementation

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file.__class__ = _VerifiedFile


_ENVIRONMENTS: dict[str, object] = {}
"""Inner functions with which Numba's code prints, by the name of their variable."""


class _Library(numba.core.codegen.JITCodeLibrary):
    """Code of a function that Python calls, and of all that it calls.

    What it calls is its own: so calls do not hand on, field by field, what their function does not look at. A step
    on a surface spent a quarter of its time with that.
    """

    def _optimize_final_module(self) -> None:
        copied = llvmlite.binding.Linkage.linkonce_odr
        for function in self._final_module.functions:
            if function.linkage == copied and not function.name.startswith("NRT_"):
                function.linkage = "internal"
        super()._optimize_final_module()

    def _finalize_specific(self) -> None:
        super()._finalize_specific()
        for variable in self._final_module.global_variables:
            if variable.name in _ENVIRONMENTS:
                self._codegen.set_env(variable.name, _ENVIRONMENTS[variable.name])


class _InnerLibrary(numba.core.codegen.JITCodeLibrary):
    """Code that is optimised and made machine code as a part of its callers alone.

    Numba does both for every function, and again for all that it calls with each of its callers.
    """

    class codegen:  # noqa: N801  (stands for the engine that runs code, which this code is not in)
        set_env = _ENVIRONMENTS.__setitem__

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _Given(types.Type):
    """A named tuple that Python gives: code reads its members where they lie, and hands it on as a pointer.

    Numba hands on each number of each array of it. A thousand with every call took a third of a step.
    """

    def __init__(self, plain: types.BaseTuple) -> None:
        members = [member.plain if isinstance(member, _Given) else member for member in plain]
        self.plain: Any = types.BaseTuple.from_types(members, plain.instance_class)
        digest = hashlib.blake2b(self.plain.name.encode(), digest_size=8).hexdigest()
        super().__init__(f"{plain.instance_class.__name__}{digest}")


_plain_type_of = numba.extending.typeof_impl.dispatch(tuple)


@numba.extending.typeof_impl.register(tuple)
def _type_of(given: tuple, context: Any) -> types.Type:
    plain = _plain_type_of(given, context)
    return _Given(plain) if isinstance(plain, types.BaseNamedTuple) else plain


@numba.extending.register_model(_Given)
class _Pointer(numba.extending.models.PrimitiveModel):
    def __init__(self, models: Any, given: _Given) -> None:
        super().__init__(models, given, models[given.plain].get_value_type().as_pointer())


@numba.extending.unbox(_Given)
def _unboxed(given: _Given, value: Any, c: Any) -> Any:
    plain = c.unbox(given.plain, value)

    def let_go() -> None:
        if plain.cleanup is not None:
            plain.cleanup()
        if c.context.enable_nrt:
            c.context.nrt.decref(c.builder, given.plain, plain.value)

    place = cgutils.alloca_once_value(c.builder, plain.value)
    return numba.extending.NativeValue(place, is_error=plain.is_error, cleanup=let_go)


@numba.core.typing.templates.infer_getattr
class _Members(numba.core.typing.templates.AttributeTemplate):
    key = _Given

    def generic_resolve(self, given: _Given, name: str) -> types.Type:
        member = given.plain[given.plain.fields.index(name)]
        return _Given(member) if isinstance(member, types.BaseNamedTuple) else member


@numba.core.imputils.lower_getattr_generic(_Given)
def _member(context: Any, builder: Any, given: _Given, pointer: Any, name: str) -> Any:
    number = given.plain.fields.index(name)
    place, of = cgutils.gep_inbounds(builder, pointer, 0, number), given.plain[number]
    if isinstance(of, types.BaseNamedTuple):
        return place
    return numba.core.imputils.impl_ret_borrowed(context, builder, of, builder.load(place))


class _Compiler(numba.core.compiler.Compiler):
    """Puts code in libraries of these two kinds."""

    def define_pipelines(self) -> list:
        state = self.state
        kind = _InnerLibrary if state.flags.no_cpython_wrapper else _Library
        state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().define_pipelines()


def _compile(function: Callable[..., Any], **options: Any) -> Any:  # Numba's dispatcher has no type
    return numba.njit(error_model="numpy", no_cfunc_wrapper=True, pipeline_class=_Compiler, **options)(
        function
    )


def compiled(function: Callable[..., Any] | None = None, *, allocates: bool = False) -> Any:
    """Decorate a function that Python calls; `allocates`: see :func:`inner`."""
    if function is None:
        return functools.partial(compiled, allocates=allocates)
    dispatcher = _compile(function, _nrt=allocates)
    if FOLDER is not None and not numba.core.config.DISABLE_JIT:
        dispatcher._cache = _Cache(function)
    return dispatcher


def inner(function: Callable[..., Any] | None = None, *, allocates: bool = False) -> Any:
    """Decorate a function that only compiled code calls: it is compiled and kept within its callers.

    One that makes or returns arrays `allocates`. In all others nobody counts who holds an array: counting it anew in
    every call and slice took three quarters of a shake.
    """
    if function is None:
        return functools.partial(inner, allocates=allocates)
    return _compile(function, no_cpython_wrapper=True, _nrt=allocates)
