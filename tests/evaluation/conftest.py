import pytest
from planted_study import planted_test_quantities

from wearscope.surrogates.fitting import fit_surrogates


@pytest.fixture(scope="session")
def quantities():
    return planted_test_quantities(seed=3)[0]


@pytest.fixture(scope="session")
def surrogates(quantities):
    return fit_surrogates(quantities, ["full", "simplified"])


@pytest.fixture(scope="session")
def odd(quantities):
    """Surrogates of one robot and cycle with A rising, B falling, C always the same."""
    part = quantities.query("robot == 'medium' and cycle == 'a'").copy()
    part.loc[part["fda"] == "B", "y"] *= -1
    part.loc[part["fda"] == "C", "y"] = 0.3
    return fit_surrogates(part, ["full", "simplified"])
