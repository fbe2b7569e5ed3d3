"""What reads data of other people's making, each as a function of bytes."""
