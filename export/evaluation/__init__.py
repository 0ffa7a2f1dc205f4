"""What a robot computes, for B robots at once in numpy: for training and evaluation."""
