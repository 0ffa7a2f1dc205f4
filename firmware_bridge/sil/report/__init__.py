"""What a run of edge-sil ends with; records alone, for whoever writes, judges or draws them."""
