"""``glsim tune``: change a sensor's noise in a browser and see the frame at once.

These modules need no browser: ``tuning`` stores the user's changes with undo, ``preview`` draws
frames on the GL thread, ``controls`` defines sliders of declared parameters, ``figures`` measures
frames, ``sensor_file`` writes a sensor. ``page`` is the page itself (NiceGUI, extra
``glsim[tune]``), ``access`` decides who may open it, ``assets`` has its scripts.
"""
