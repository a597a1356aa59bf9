"""Whether the rocks of a campaign stand by themselves, and how far they settle: found out before any job is done."""

from collections.abc import Mapping

from toppling.models.contact import ContactProperties
from toppling.models.errors import InputError
from toppling.models.scene import Scene
from toppling.models.settling import Settling
from toppling.orchestrator.campaign import Campaign
from toppling.workers.seating import settled

Settlings = Mapping[tuple[float, float], Settling | InputError]
"""How far a rock settles with each static and kinetic friction, or why it does not stand."""


def check_stands(campaign: Campaign, scene: Scene) -> Settling:
    """Make sure that the rock stands by itself with every friction of the campaign, and say how far it settles.

    Otherwise every job would find it out again. Where the campaign has realisations, only the nominal one is looked at.

    Returns Settling: with the friction with which it tilts most.
    Raises InputError if it does not.
    """
    found = settlings(campaign, scene)
    for one in found.values():
        if isinstance(one, InputError):
            raise one
    return max((one for one in found.values() if isinstance(one, Settling)), key=lambda one: one.tilt_deg)


def settlings(campaign: Campaign, scene: Scene) -> Settlings:
    """How far the nominal rock settles with each friction of the campaign, or why it does not stand."""
    found: dict[tuple[float, float], Settling | InputError] = {}
    for static, kinetic in sorted(set(campaign.friction)):
        try:
            under = scene.with_contact(ContactProperties.of((static, kinetic)))
            found[static, kinetic] = Settling.between(scene.rock, settled(under).rock, scene.pedestal.normal)
        except InputError as error:
            found[static, kinetic] = InputError(
                f"with friction {static:g}: {error.what}",
                where=str(campaign.scene),
                expected=error.expected,
                remedy=error.remedy,
            )
    return found
