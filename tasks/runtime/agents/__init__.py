"""Robots that are programs of their own: the agent protocol, its client, and recorded actions.

May import: `schemas`, `tasks.runtime.episode`, `tasks.runtime.limits`.
"""

__all__ = ["action_log", "agent_client", "agent_socket", "recorded_robot", "remote_agent", "remote_robot"]
