"""Saving fails, or a save is damaged, scaled out: the tests of the embedded set-up."""

from __future__ import annotations

import pytest

from tests.faults.test_saving import (  # noqa: F401 - run here, too
    test_a_save_that_was_cut_in_half_is_passed_over,
    test_acting_goes_on_while_the_folder_of_saves_cannot_be_written,
)

pytestmark = [pytest.mark.service, pytest.mark.long]
