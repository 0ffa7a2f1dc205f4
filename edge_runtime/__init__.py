"""The robot side: observe, sample a flow policy guided by execution-time objectives, command."""
