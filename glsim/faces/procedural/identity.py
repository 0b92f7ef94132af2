"""Identity: one displacement field a parameter, in mm a unit of the parameter.

``FIELDS[name](canvas)`` gives (N, 3). Fields are tuned so that the measurement named in
parameters.py changes by one unit; tests/test_faces_procedural.py measures it. Lids and ears, which
move as they like, have theirs in identity_parts.py.
"""

from __future__ import annotations

from collections.abc import Mapping

from glsim.faces.procedural import identity_jaw, identity_nose_eyes, identity_skull
from glsim.faces.procedural.fields import Field

FIELDS: Mapping[str, Field] = {
    **identity_skull.FIELDS,
    **identity_nose_eyes.FIELDS,
    **identity_jaw.FIELDS,
}
