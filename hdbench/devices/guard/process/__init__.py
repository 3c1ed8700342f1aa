"""The guard itself, run as a process of its own.

It is handed the bytes that stop the motor and the bytes that prove it, and waits. When the session
that started it ends without a word, or says nothing for too long while the motor may turn, it sends
them over a connection of its own until two rounds of reading back in a row find the motor standing.

First line on standard input: a port of this computer and a secret word, with which it calls the
session there. First line from the session: the order, as JSON. Then single letters: ``A`` watch
closely, ``L`` watch with more patience, ``I`` watch for the end only, ``.`` a sign of life, ``Q``
the safe state was confirmed: leave. It answers every read with ``.``, and with a line ``R...``
ready, ``E...`` the device does not answer, ``F...`` it stops the motor now, and why.

Of hdbench it loads the wire and the room of the operating system alone, which need nothing but the
standard library and pyserial: it starts in a few hundredths of a second, takes some ten megabytes,
and nothing that breaks the session breaks it. `hdbench.devices.guard.session` runs it with this
folder's parent behind the standard library, so its modules name each other by their places.
"""
