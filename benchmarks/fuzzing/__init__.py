"""The readers of external data, each as a function of bytes."""
