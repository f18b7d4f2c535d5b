"""Import of worlds in Gazebo's format (SDF): collision shapes, MuJoCo model, map, checks and bundle."""
