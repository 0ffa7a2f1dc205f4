"""ONNX graphs of velocity fields: written, read, recognised and differentiated."""
