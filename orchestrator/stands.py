"""Whether the rocks of a campaign stand by themselves, and how far they settle: found out before any job is done."""

from collections.abc import Mapping
from dataclasses import dataclass

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.models.settling import Settling
from toppling.orchestrator.campaign import Campaign
from toppling.workers.seating import settled


@dataclass(frozen=True)
class Settlings:
    """How far a nominal rock settles with each friction of a campaign, or why it does not stand."""

    with_friction: Mapping[tuple[float, float], Settling | InputError]  # static and kinetic

    @classmethod
    def of(cls, campaign: Campaign, scene: Scene) -> "Settlings":
        """Let the rock settle with each."""
        found: dict[tuple[float, float], Settling | InputError] = {}
        for static, kinetic in sorted(set(campaign.friction)):
            try:
                under = scene.with_contact(ContactProperties.of((static, kinetic)))
                found[static, kinetic] = Settling.between(
                    scene.rock, settled(under).rock, scene.pedestal.normal
                )
            except InputError as error:
                found[static, kinetic] = InputError(
                    f"with friction {static:g}: {error.what}",
                    where=str(campaign.scene),
                    expected=error.expected,
                    remedy=error.remedy,
                )
        return cls(found)

    @property
    def problems(self) -> list[InputError]:
        """Why the rock does not stand."""
        return [one for one in self.with_friction.values() if isinstance(one, InputError)]

    @property
    def largest(self) -> Settling | None:
        """That by which the rock tilts most; None if it stands with no friction."""
        stands = [one for one in self.with_friction.values() if isinstance(one, Settling)]
        return max(stands, key=lambda one: one.tilt_deg, default=None)

    def checked(self) -> Settling | None:
        """The largest; a rock that does not stand with every friction is refused, else every job would find it out.

        Raises InputError if it does not stand.
        """
        for problem in self.problems:
            raise problem
        return self.largest
