"""The workstation side: train policies and write the bundles that robots run."""
