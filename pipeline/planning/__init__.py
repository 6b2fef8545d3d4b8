"""How an arm can move: kinematics, inverse kinematics, collision checking, path search, time
parameterisation, the planner.

`Planner` holds what is constant for a robot. A `PlanningScene` describes one moment; an
`ArmPlanner` plans for one arm in it and returns `ArmTrajectory`s. Nothing here knows the simulation
or the expert.

Forward kinematics exists once for each purpose. `ik_kernels.forward` computes the tcp of a serial
chain together with the joint axes that its Jacobian needs. `collision_kernels.place_frames`
computes all joint frames of both arms, jaws included. Both are compiled, in two files because
numba's disk cache does not notice changes in other files. `world.robots.forward.link_poses`
computes all links by name in plain numpy, for building, checking and drawing. The tests compare the
three with pinocchio.
"""
