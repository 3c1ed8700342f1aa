"""`hdbench emulate` is open to this machine only, unless a word says otherwise."""

import pytest


@pytest.mark.parametrize("address", ["0.0.0.0", "192.168.0.7", "::"])
def test_another_address_than_the_loopback_needs_the_word(address, answer):
    error = answer("emulate", "--listen", address, code=2)["error"]
    assert (error["exit_code"], error["where"]) == (2, "--listen")
    assert "--unprotected" in error["fix"]
