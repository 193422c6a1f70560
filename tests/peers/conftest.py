"""The marker of the tests that need the peers' environments."""


def pytest_configure(config):
    config.addinivalue_line("markers", "peers: against public simulators, in environments of their own; `make peers`")
