"""Where the frames of the simulated robot are: /tf and /tf_static, if tf2_msgs is there."""
