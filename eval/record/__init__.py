"""Recorded episodes, and how they are shown: words, figures, films, ONNX."""
