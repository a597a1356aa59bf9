"""Interface of a physics engine to the program."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import TYPE_CHECKING

from toppling.models.errors import InputError
from toppling.models.pedestal import ContactProperties
from toppling.workers.options import PRESETS, NumericalOptions

if TYPE_CHECKING:
    from toppling.models.ground.stepping import Grounded
    from toppling.workers.problem import Problem
    from toppling.workers.stepping import Watch


Steps = Callable[["Grounded", int, "Watch"], int]
"""Takes blocks of so many steps of a rock, one or until a look is called for.

The trajectory's arrays have room for one. Returns the index of the pose in which the last block began; -1 where it
needs the meshes of rock and ground, and has taken none.
"""


class StepCheckError(RuntimeError):
    """An engine has repeated a step of the program's own and moved the rock elsewhere: the job has no answer.

    Parameters
    ----------
    time_s : float
        Of the shake.
    unlike : float
        Largest difference of a pose or of the least gap, over R.
    allowed : float
    """

    def __init__(self, time_s: float, unlike: float, allowed: float) -> None:
        self.time_s, self.unlike, self.allowed = time_s, unlike, allowed
        super().__init__(time_s, unlike, allowed)

    def __str__(self) -> str:
        return (
            f"at {self.time_s:.4f} s the engine repeats a step of the program's own and comes elsewhere: by "
            f"{self.unlike:.1e} of the rock's size, where {self.allowed:.0e} is allowed. Report the job"
        )


@cache
def _is_there(package: str) -> bool:
    """Whether a package can be imported; it is not: PyBullet then writes to every terminal when it was built."""
    with contextlib.suppress(ImportError):  # of the package that it lies in
        return find_spec(package) is not None
    return False


@dataclass(frozen=True)
class Engine:
    """A physics engine behind the seam.

    Parameters
    ----------
    name : str
        As a campaign names it; also that of the distribution that must be installed.
    title, authors, reference : str
        How it is called and cited.
    module : str
        Which module has its `steps(problem)`.
    relative_steps : mapping
        Time step over sqrt(R / g) of each preset, where it is not that of :data:`PRESETS`.
    restitution, kinetic_friction : bool
        Whether it knows a coefficient of restitution, and a kinetic friction apart from the static one.
    extra : str or None
        Of this distribution, which installs it; None where it always is.
    imports : str
        The module whose import proves that it is installed.
    """

    name: str
    title: str
    authors: str
    reference: str
    module: str
    imports: str
    relative_steps: Mapping[str, float]
    restitution: bool = True
    kinetic_friction: bool = True
    extra: str | None = None

    @cached_property
    def presets(self) -> dict[str, NumericalOptions]:
        """Options by the names of the presets."""
        return {
            name: options.with_step(self.relative_steps[name]) if name in self.relative_steps else options
            for name, options in PRESETS.items()
        }

    @property
    def version(self) -> str | None:
        """Version of the installed distribution; None where it is not installed."""
        try:
            return version(self.name)
        except PackageNotFoundError:
            return None

    @property
    def citation(self) -> dict[str, str]:
        """For a run's description: name, title, authors, reference."""
        return {
            "name": self.name,
            "title": self.title,
            "authors": self.authors,
            "reference": self.reference,
        }

    def models(self, frictions: Iterable[tuple[float, float]], restitutions: Iterable[float]) -> bool:
        """Whether it knows all of some (static, kinetic) frictions and some coefficients of restitution."""
        apart = any(static != kinetic for static, kinetic in frictions)
        return (self.kinetic_friction or not apart) and (self.restitution or not any(restitutions))

    def beyond(self, contact: ContactProperties) -> str | None:
        """Which of a contact's properties it does not know; None where it knows all."""
        if contact.restitution > 0.0 and not self.restitution:
            return f"restitution {contact.restitution:g}"
        if contact.friction_static != contact.friction_kinetic and not self.kinetic_friction:
            return f"friction {contact.friction_static:g} at rest and {contact.friction_kinetic:g} in slip"
        return None

    def require(self) -> None:
        """Make sure that it is installed.

        Raises
        ------
        InputError
            If it is not.
        """
        if not _is_there(self.imports):
            raise InputError(
                "package.not_installed",
                f"{self.title} is not installed here",
                where=f"engine {self.name}",
                expected=f"the extra '{self.extra}'" if self.extra else f"the package {self.name}",
                remedy=f"pip install 'toppling[{self.extra}]', or take another engine"
                if self.extra
                else "install toppling anew",
            )

    def steps(self, problem: Problem) -> Steps:
        """Stepper of a single shake.

        Raises
        ------
        InputError
            If the engine is not installed, the scene's contact is beyond it, or it cannot represent the scene.
        """
        self._require_all(problem.scene.contact)
        made: Steps = import_module(self.module).steps(problem)
        return made

    def _require_all(self, contact: ContactProperties) -> None:
        """Make sure that it is installed and knows the contact."""
        self.require()
        if (what := self.beyond(contact)) is not None:
            raise InputError(
                "engine.contact_unknown",
                what,
                where=f"engine {self.name}",
                expected="restitution 0 and one coefficient of friction",
                remedy="shake with the default engine, or change the contact's properties",
            )
