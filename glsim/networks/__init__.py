"""Networks that denoise depth maps: their inputs, files, safeguards, and the maps made from them.

``interface`` says what a denoising function takes and returns, ``inputs`` what a network sees
besides the depth of its frame, ``record`` the settings of its files. ``network`` runs one on whole
frames: ``tiles`` cuts them, ``safeguards`` and ``composites`` judge the result. ``onnx_file`` and
``checkpoint`` read and write the files. Training and denoising both build on this.
"""
