"""The operating system: every call that not every system has, each with what stands in for it.

No other room asks which system it runs on. ``docs/reliability.md`` says which promise is weaker
where. Beside the standard library only pyserial and psutil are used, and imported when needed: the
guard process loads this room.
"""
