"""The command line `vtrack`."""
