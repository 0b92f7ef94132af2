"""Identity fields: one displacement field per parameter, in mm per unit of the parameter.

``FIELDS[name](field_points)`` returns (N, 3). A field of weight 1 changes the measurement
named in parameters.toml by one unit; tests/faces/test_procedural.py measures this. Fields of lids
and ears, which move on their own, are in identity_parts.py.
"""

from __future__ import annotations

from collections.abc import Mapping

from tools.heads import identity_bust, identity_jaw, identity_nose_eyes, identity_skull
from tools.heads.fields import Field

FIELDS: Mapping[str, Field] = {
    **identity_skull.FIELDS,
    **identity_nose_eyes.FIELDS,
    **identity_jaw.FIELDS,
    **identity_bust.FIELDS,
}
