"""What several packages of the workstation share: processes that train together, files written whole."""
