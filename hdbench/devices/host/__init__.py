"""Host control: a bench made of any DAQ, its reference and its checks."""
