"""``glsim tune``: change a sensor's noise in a browser and see the frame at once.

``state`` holds what the user has changed, with undo, and writes it out; ``bench`` draws frames on
the GL thread; ``controls`` turns declared parameters into sliders; ``statistics`` and ``recording``
measure; ``packet`` packs a picture for the browser. These need no browser. ``page`` and ``server``
are the page itself (NiceGUI, extra ``glsim[tune]``); ``assets`` its scripts.
"""
