"""Gymnasium's `pushgraph/Push-v0`: bring a body to its goal, push by push. Importing this module registers it.

gymnasium.make("pushgraph.environment:pushgraph/Push-v0")
gymnasium.make_vec("pushgraph.environment:pushgraph/Push-v0", num_envs=1000)
"""

from pushgraph.extras import extra

with extra("gym", "pushgraph.environment"):
    import gymnasium

ID = "pushgraph/Push-v0"
PUSHES = 10
"""Pushes of an episode, unless `max_episode_steps` says otherwise."""

gymnasium.register(
    ID,
    entry_point="pushgraph.environment.push_env:PushEnv",
    vector_entry_point="pushgraph.environment.push_env:PushVectorEnv",
    max_episode_steps=PUSHES,
)
