"""One engine for every kind of data: is the model right, and if not, what is wrong.

It knows only :mod:`trunnion.diagnosis.protocol`.
"""

from trunnion.diagnosis.registry import diagnose, model_of, register
from trunnion.diagnosis.result import Alternative, Cause, Diagnosis, Gain

__all__ = ["Alternative", "Cause", "Diagnosis", "Gain", "diagnose", "model_of", "register"]
