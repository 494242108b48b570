import pytest

@pytest.mark.hilrig("robot.toml")
def test_it_stops_before_the_wall(rig):
    rig.run("python3 robot.py").assert_passed()
