"""The paper's numbered equations hold as printed, and those that do not are named."""

import json

from gramian.reproduce import reproduce


def test_every_equation_but_the_misprint_holds():
    report = reproduce("li-sheng-2009")
    assert report.headline == "REPRODUCED"
    found = {item["number"]: item for item in report.data["equations"]}
    assert {str(n) for n in range(1, 16)} <= set(found)
    wrong = [number for number, item in found.items() if item["relative_difference"] > 1e-9]
    assert wrong == ["7"]
    assert "T and T^2" in found["7"]["misprint"]
    # The determinant of the reference geometry, to all digits of double precision.
    assert abs(found["6"]["printed"] / 942924.4480085992 - 1) < 1e-13
    assert abs(found["15"]["printed"] / -62.18371675894412 - 1) < 1e-13
    assert json.loads(report.to_json())["headline"] == "REPRODUCED"
    assert len(report.pictures[0].draw().axes) == 2
