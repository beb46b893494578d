"""What Python users call: robots, models and recordings in; runs and diagnoses out."""

from ..recording import Recording
from .diagnosis import diagnose
from .healing import heal
from .identification import identify
from .recovery import recover

__all__ = ["Recording", "diagnose", "heal", "identify", "recover"]
