"""What we are measured against and cv2 has not got. Each has cv2's ``init`` and ``update``."""
