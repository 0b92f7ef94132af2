"""``glsim tune``: change a sensor's noise in a browser and see the frame at once.

``tuning`` holds what the user has changed, with undo, and writes it out; ``preview`` draws frames
on the GL thread; ``controls`` turns declared parameters into sliders; ``figures`` measures;
``sensor_file`` saves. These need no browser. ``page`` is the page itself (NiceGUI, extra
``glsim[tune]``), ``access`` says who may open it; ``assets`` holds its scripts.
"""
