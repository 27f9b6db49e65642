"""
Mapping: keyframes and the features in them, as one geometry, adjusted while driving.

Two views lose their information where the baseline between them ends. Here keyframes along the
way, the inverse depths of features and the attitude of the camera are estimated together, in a
sliding window of bundle adjustment; each new view is localized in that map, as surely as the map
is known.
"""
