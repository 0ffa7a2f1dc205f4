"""Flow policies: manifest, weights, bundle, and the velocity field in numpy, compiled C and onnxruntime."""
