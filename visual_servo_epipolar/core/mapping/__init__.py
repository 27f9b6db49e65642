"""
Memory of views: what was seen on the way, as one geometry of views and features.

Two views know nothing where their baseline ends. Here well-spread views (keyframes), the depths of
the photograph's features and the attitude of the camera are estimated together (a sliding window
of bundle adjustment), and each new view by resection on that structure, as sure as it is.
"""
