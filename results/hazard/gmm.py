"""Ground-motion models of the optional package pygmm: median and sigma of a measure, given magnitude and distance.

pygmm (MIT, 0.2 MB, no new dependencies) is preferred to OpenQuake's hazardlib (AGPL, 156 MB, with GDAL): both give the
same numbers for Boore et al. (2014) (0.14971 g and 12.837 cm/s at magnitude 7, 20 km, Vs30 760 m/s). It has no
subduction models and no NGA-East.
"""

import importlib
import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from toppling.models.errors import InputError, optional_module
from toppling.models.motions.measures import STANDARD_G_M_S2

MODELS = {
    "ask14": "AbrahamsonSilvaKamai2014",
    "bssa14": "BooreStewartSeyhanAtkinson2014",
    "cb14": "CampbellBozorgnia2014",
    "cy14": "ChiouYoungs2014",
    "i14": "Idriss2014",
    "asb14": "AkkarSandikkayaBommer2014",
    "c03": "Campbell2003",
    "tp05": "TavakoliPezeshk05",
}
"""pygmm's class of each model, by the name used here.

Left out: Atkinson and Boore (2006) and Pezeshk et al. (2011), whose standard deviations pygmm 0.8 gives in base 10
instead of natural logarithms, and the PGV of the former a thousand times too low.
"""

MECHANISMS = ("SS", "NS", "RS", "U")
"""Styles of faulting: strike slip, normal, reverse, unknown."""

MEASURES = {"pga_m_s2": None, "pgv_m_s": None, "sa_1s_m_s2": 1.0, "sa_2s_m_s2": 2.0}
"""Measures that the models predict, with the period of spectral accelerations, s."""

_BETWEEN_EVENTS = {"pgv_m_s": (0.3733, 0.3639, 0.3434, 0.3236), "": (0.4518, 0.4270, 0.3863, 0.3508)}
"""Between-event standard deviation tau at magnitudes 4.5, 5, 5.5 and 6.5 (Al Atik, 2015, PEER 2015/07, global model),
of PGV and of accelerations; constant beyond."""
_SINGLE_STATION = {
    "pgv_m_s": (0.5034, 0.3585), "pga_m_s2": (0.5477, 0.3505), "sa_1s_m_s2": (0.4519, 0.4257),
    "sa_2s_m_s2": (0.4026, 0.4026),
}  # fmt: skip
"""Single-station within-event standard deviation phi_SS at magnitudes 5 and 6.5 (the same global model)."""

_MAGNITUDES = (4.5, 8.5)
_DISTANCES_KM = (1.0, 300.0)
"""Ranges of magnitude and distance (km) that models are evaluated in; each model's own limits narrow them."""


@dataclass(frozen=True)
class GroundMotionModel:
    """A ground-motion model for one measure, site and style of faulting.

    The site lies on the footwall of a fault whose top edge is `depth_top_km` deep: the distance is that to the surface
    above the top edge (Joyner-Boore), from which the distance to the rupture follows.

    Raises InputError if pygmm is not installed, the model is unknown, or does not cover the site or the mechanism.
    """

    name: str  # one of `MODELS`
    measure: str  # column of the results
    vs30_m_s: float  # shear-wave velocity of the upper 30 m at the rock
    mechanism: str = "SS"  # one of `MECHANISMS`
    # Dip of the fault, and depth of its top edge.
    dip_deg: float = 90.0
    depth_top_km: float = 0.0
    # Whether Vs30 is measured or inferred, depth of the hypocentre, and depth to a shear-wave velocity of 1 km/s; None
    # for the model's own estimate.
    vs30_source: str = "measured"
    hypocentre_km: float | None = None
    depth_1_0_km: float | None = None
    # Ratio of the horizontal vector's peak to the model's component (RotD50 for the NGA-West2 models).
    ratio: float = 1.0

    def __post_init__(self) -> None:
        if self.name not in MODELS:
            raise _model_error(
                "model.unknown",
                f"{self.name!r} is no ground-motion model known here",
                f"one of {', '.join(MODELS)}",
            )
        if self.measure not in MEASURES:
            raise _model_error(
                "measure.unknown",
                f"has no model of {self.measure}",
                f"one of {', '.join(MEASURES)}",
                "--measure",
            )
        limits = self._limits("v_s30")
        if not (self.vs30_m_s > 0 and (limits is None or limits[0] <= self.vs30_m_s <= limits[1])):
            expected = (
                "a velocity above 0"
                if limits is None
                else f"{limits[0]:g} to {limits[1]:g} m/s for {self.name}"
            )
            raise _model_error(
                "model.vs30_out_of_range", f"a Vs30 of {self.vs30_m_s:g} m/s", expected, "--vs30"
            )
        options = next(
            (parameter.options for parameter in self._class.PARAMS if parameter.name == "mechanism"), None
        )
        if options is not None and self.mechanism not in options:
            raise _model_error(
                "model.mechanism_unknown",
                f"{self.name} has no mechanism {self.mechanism!r}",
                f"one of {', '.join(options)}",
            )

    @cached_property
    def _class(self) -> Any:
        return getattr(optional_module("pygmm", "--model", "'toppling[gmm]'"), MODELS[self.name])

    @property
    def magnitudes(self) -> tuple[float, float]:
        """Range of magnitudes of the model."""
        return self._within("mag", _MAGNITUDES)

    @property
    def distances_km(self) -> tuple[float, float]:
        """Range of distances of the model."""
        name = "dist_jb" if self._limits("dist_rup") is None else "dist_rup"
        return self._within(name, _DISTANCES_KM)

    @property
    def has_site_term(self) -> bool:
        """Whether the model depends on Vs30; others are for hard rock."""
        return any(parameter.name == "v_s30" for parameter in self._class.PARAMS)

    def motion(self, magnitude: ArrayLike, distance_km: ArrayLike) -> tuple[NDArray, NDArray, NDArray]:
        """Natural logarithm of the median (SI), sigma and its part between sites, by broadcast magnitude and distance.

        sigma^2 = tau^2 + phi_S2S^2 + phi_SS^2 (Al Atik et al., 2010): phi_S2S is what the global tau and phi_SS leave
        of the model's sigma, 0 where they leave nothing.
        """
        pairs = np.broadcast(np.asarray(magnitude, float), np.asarray(distance_km, float))
        found = np.array([self._point(*pair) for pair in pairs]).reshape(*pairs.shape, 2)
        mean, sigma = found[..., 0], found[..., 1]
        between_events, single_station = single_station_parts(self.measure, magnitude)
        return mean, sigma, np.sqrt(np.maximum(sigma**2 - between_events**2 - single_station**2, 0.0))

    def _point(self, magnitude: float, distance_km: float) -> tuple[float, float]:
        pygmm = importlib.import_module("pygmm")
        rupture_km = math.hypot(distance_km, self.depth_top_km)
        wanted = {
            "mag": magnitude, "dist_jb": distance_km, "dist_rup": rupture_km, "dist_x": -distance_km,
            "v_s30": self.vs30_m_s, "mechanism": self.mechanism, "dip": self.dip_deg,
            "depth_tor": self.depth_top_km, "vs_source": self.vs30_source, "depth_hyp": self.hypocentre_km,
            "depth_1_0": self.depth_1_0_km,
        }  # fmt: skip
        known = {parameter.name for parameter in self._class.PARAMS}
        with _quiet():
            model = self._class(
                pygmm.Scenario(
                    **{name: value for name, value in wanted.items() if name in known and value is not None}
                )
            )
            try:
                return self._read(model)
            except NotImplementedError:
                raise _model_error(
                    "model.measure_not_given",
                    f"{self.name} does not give {self.measure}",
                    "a measure of the model",
                ) from None

    def _read(self, model: Any) -> tuple[float, float]:
        period = MEASURES[self.measure]
        if self.measure == "pga_m_s2":
            median, sigma = model.pga * STANDARD_G_M_S2, model.ln_std_pga
        elif period is None:
            median, sigma = model.pgv / 100.0, model.ln_std_pgv
        else:
            median = model.interp_spec_accels([period])[0] * STANDARD_G_M_S2
            sigma = model.interp_ln_stds([period])[0]
        return math.log(float(median) * self.ratio), float(sigma)

    def _limits(self, name: str) -> tuple[float, float] | None:
        """Limits of a parameter as the model states them; None if it has no such parameter, or no limit."""
        parameter = next((known for known in self._class.PARAMS if known.name == name), None)
        low, high = getattr(parameter, "min", None), getattr(parameter, "max", None)
        if parameter is None or (low is None and high is None):
            return None
        return (-math.inf if low is None else float(low), math.inf if high is None else float(high))

    def _within(self, name: str, widest: tuple[float, float]) -> tuple[float, float]:
        low, high = self._limits(name) or widest
        return max(low, widest[0]), min(high, widest[1])


def single_station_parts(measure: str, magnitude: ArrayLike) -> tuple[NDArray, NDArray]:
    """Parts tau and phi_SS of sigma at one site, by the global model of Al Atik (2015)."""
    at, tau = np.asarray(magnitude, float), _BETWEEN_EVENTS.get(measure, _BETWEEN_EVENTS[""])
    return np.interp(at, (4.5, 5.0, 5.5, 6.5), tau), np.interp(at, (5.0, 6.5), _SINGLE_STATION[measure])


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence pygmm's warnings: models are not evaluated outside their limits."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _model_error(code: str, what: str, expected: str, where: str = "--model") -> InputError:
    return InputError(
        code, what, where=where, expected=expected, remedy="choose another model, or another measure"
    )
