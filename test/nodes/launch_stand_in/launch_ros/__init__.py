"""As much of ``launch_ros`` as the launch files use."""
