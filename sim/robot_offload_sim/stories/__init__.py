"""Single executions with one point each: a small world, one rule, in words before the violation.

`stage` and `goal_stage` set a world up and drive it, `stories` lists all by name, `goal_storm` lives many goals.

Never here: chance that is not drawn from the stage's own seed.
"""
