"""Functions decorated with ``validation_check``, which measure the checks of sensors."""
