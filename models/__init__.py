"""What is shaken and what shakes it: scenes and motions. Knows no engine and no cluster."""

from models.errors import InputError
from models.motions.motion import Motion
from models.pedestal import Pedestal
from models.rock import Rock
from models.scene import ContactProperties, Scene

__all__ = ["ContactProperties", "InputError", "Motion", "Pedestal", "Rock", "Scene"]
