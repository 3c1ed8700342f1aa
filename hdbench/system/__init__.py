"""The operating system: every call that not every system has, each with what stands in for it.

No other room asks which system it runs on. ``docs/reliability.md`` says which promise is weaker
where. The standard library, pyserial and psutil are all that is imported here, each when it is
needed: the guard process loads parts of this room.
"""
