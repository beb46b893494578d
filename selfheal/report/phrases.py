"""Words of a diagnosis: names of effects and verdicts in, phrases out."""

# what is the case at {at}, by effect; {all} are all parameters, by name
SAYS = {
    "viscous_friction": "{at} has viscous friction of {damping} {lacks}",
    "coulomb_friction": "{at} has dry friction of {frictionloss} {lacks}",
    "stribeck_friction": "{at} has dry friction {lacks}: {static} at rest, {coulomb} "
    "in motion",
    "load_dependent_friction": "{at} has friction {lacks}: {load_coefficient} of the "
    "torque that it passes on",
    "asymmetric_friction": "{at} has dry friction {lacks}: {positive} one way, "
    "{negative} the other",
    "quadratic_damping": "{at} has drag of {damping2} {lacks}",
    "backlash": "{at} has play of {gap} {lacks}",
    "compliance": "{at} gives way, with a stiffness of {stiffness} {lacks}",
    "cogging": "{at} has a torque of {amplitude} {lacks}, rippling with its angle",
    "armature": "{at} has a rotor inertia of {armature}, {other}",
    "joint_spring": "{at} has a spring of {stiffness} {lacks}",
    "joint_coupling": "{at} is coupled to another joint by {stiffness} {lacks}",
    "hard_stop": "{at} has a hard stop at {range} {lacks}",
    "command_delay": "{at} acts on its commands {delay} late",
    "actuator_lag": "{at} follows its commands with a time constant of {timeconst} "
    "{lacks}",
    "torque_saturation": "{at} cannot give more than {limit}",
    "speed_torque_limit": "{at} gives less torque the faster it turns: {stall_torque} "
    "at rest, none at {no_load_speed}",
    "rate_limit": "{at} follows its commands at {rate} at most",
    "servo_gain": "{at} has gains {other} ({all})",
    "integral_action": "{at} sums up its error with a gain of {ki}",
    "payload": "{at} carries a mass of {mass} {lacks}",
    "com_shift": "{at} has its center of mass elsewhere than in the model ({all})",
    "link_length": "{at} has a length of {length}, {other}",
    "mount_shift": "{at} is attached elsewhere than in the model ({all})",
    "limb_loss": "{at} is lost",
    "joint_jam": "{at} is stuck at {angle}",
    "slope": "the ground slopes by {tilt}, {other}",
    "fluid_drag": "a fluid {lacks} drags at {at} ({all})",
    "wind": "a wind {lacks} blows ({all})",
    "ground_friction": "contact has a friction of {friction}, {other}",
    "ground_compliance": "contact gives way, {other} ({all})",
    "sensor_bias": "{at} is off by {bias}",
    "sensor_gain": "{at} reads {gain} times what is true",
    "sensor_delay": "{at} comes {delay} late",
    "quantization": "{at} comes in steps of {step}",
}
COMMON = {"lacks": "that the model lacks", "other": "other than in the model"}
UNTOLD = (
    "These recordings cannot tell where it is wrong: too few readings lie inside, or "
    "outside, of each regime."
)
# of a verdict
MEANS = {
    "explained": "What the findings leave of short pieces is as large as noise.",
    "partly": "The findings help on recordings that the fit did not see, but what "
    "remains is not noise, and no further effect of the catalogue earns its place. "
    "Use the patched model where its error is small enough, and look at the map below "
    "for where the rest lies.",
    "unlisted": "The re-fitted model is wrong in a way that is no noise, yet no effect "
    "of the catalogue predicts recordings better that the fit did not see. The map "
    "below tells where to look.",
    "nothing": "After re-fitting what the model states, what remains on recordings "
    "that the fit did not see is as large as noise. That holds for motions like these; "
    "what was never excited cannot be seen, and stands under Remarks.",
}
