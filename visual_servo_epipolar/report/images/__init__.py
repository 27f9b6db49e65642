"""Images drawn with OpenCV: features and phases over camera images, maps, videos."""
