"""A base class of networks in tests, with the attributes of a ``Runner``."""

from glsim.networks.inputs import DEPTH_ALONE
from glsim.networks.record import DEFAULT_RECORD


class Runs:
    """Attributes of a ``glsim.networks.network.Runner`` of depth with a probability."""

    inputs, record = DEPTH_ALONE, DEFAULT_RECORD
    outputs = ("depth_mm", "probability")
