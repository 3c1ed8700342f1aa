"""`hdbench emulate`: open to this machine only, unless a word says otherwise; TCP or serial."""

import json
import signal
import sys
from subprocess import PIPE

import pytest
from changing import with_keys
from forked import hdbench_process

from hdbench.devices import stop_bench
from hdbench.profile import load_profile


@pytest.mark.parametrize("address", ["0.0.0.0", "192.168.0.7", "::"])
def test_another_address_than_the_loopback_needs_the_word(address, hdbench):
    error = json.loads(hdbench("emulate", "--json", "--listen", address, code=2)[0])["error"]
    assert (error["exit_code"], error["where"]) == (2, "--listen")
    assert "--unprotected" in error["fix"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs pseudo-terminals")
def test_on_a_serial_line_it_prints_the_address_that_a_host_opens():
    process = hdbench_process(["emulate", "--json", "--rtu"], stdout=PIPE, stderr=PIPE)
    try:
        told = json.loads(process.stdout.readline())
        assert told["address"].startswith("rtu:///dev/")
        data = load_profile("cim-tr-97-06").data
        patient = {"address": told["address"], "deadline_s": 1.5, "watchdog_s": 2.0}
        assert stop_bench(with_keys(data, daq=patient)).confirmed
        process.send_signal(signal.SIGTERM)
        rest, noise = process.communicate(timeout=60)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, rest) == (0, b"")
    assert b"Traceback" not in noise
