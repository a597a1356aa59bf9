"""Tables of rocks as spreadsheets write them."""

import pytest
from refusals import refused

from toppling.orchestrator.site_table import read_sites
from toppling.results.hazard.ages import parse_age

PLAIN = "scene,site,longitude,latitude\nrock,Zürich,-117.5,34.25\n"
SEMICOLONS = PLAIN.replace(",", ";").replace(".", ",")


@pytest.mark.parametrize(
    "content",
    [
        PLAIN.encode("utf-8-sig"), PLAIN.encode("cp1252"), PLAIN.encode("utf-16"), SEMICOLONS.encode("cp1252"),
        "Latitude;SITE; Longitude ;Scene\n34,25;Zürich;-117,5;rock\n".encode(),
        "scene,site,longitude,latitude\nrock,Zürich,117.5W,34.25 N\n".encode(),
        "scene;site;longitude;latitude\nrock;Zürich;117°30'W;N 34°15'00\"\n".encode(),
    ],
)  # fmt: skip
def test_a_table_says_the_same_however_a_spreadsheet_writes_it(content, tmp_path):
    (tmp_path / "rocks.csv").write_bytes(content)
    (site,) = read_sites(tmp_path / "rocks.csv")
    assert (site.rock, site.site, site.longitude, site.latitude) == ("rock", "Zürich", -117.5, 34.25)


@pytest.mark.parametrize("table", ["age (ka)\n15..30", "Age [kyr]\n15..30", "age_ka\n15..30 ka", "age\n15..30 ka",
                                   "age\n15000..30000", "age (yr)\n15..30 ka"])  # fmt: skip
def test_an_age_is_in_the_unit_of_its_column_or_its_own(table, tmp_path):
    header, age = table.split("\n")
    (tmp_path / "rocks.csv").write_text(f"scene,{header}\nrock,{age}\n")
    (site,) = read_sites(tmp_path / "rocks.csv")
    assert parse_age(site.age) == pytest.approx(parse_age("15000..30000"))


def test_rocks_are_named_as_people_name_them_and_remarks_of_a_table_are_left_alone(tmp_path):
    (tmp_path / "rocks.csv").write_text(
        'scene,rock,site,Comment\na,"O\'Brien\'s Rock #3 (north)",St. John\'s & co,"hello, world"\n'
    )
    (site,) = read_sites(tmp_path / "rocks.csv")
    assert (site.rock, site.site) == ("O'Brien's Rock #3 (north)", "St. John's & co")
    for wrong in ("a/b", "..", "<b>", "a?b", "-a", "a."):
        (tmp_path / "rocks.csv").write_text(f"scene,rock\na,{wrong}\n")
        with refused("campaign.value_unusable"):
            read_sites(tmp_path / "rocks.csv")


REFUSED = {
    "table.row_wrong_length": ["scene,longitude,latitude\nrock,-117,5,34,25\n"],
    "campaign.value_unusable": [
        "scene,longitude,latitude\nrock,543.5,34\n", "scene,longitude,latitude\nrock,-117,91\n",
        "scene,longitude,latitude\nrock,11855,34\n", "scene,longitude,latitude\nrock,east,1\n",
        "scene,longitude,latitude\nrock,34.25,-117.5\n", "scene,longitude,latitude\nrock,34.25N,117.5W\n",
        "scene,longitude,latitude\nrock,117.5X,34.25\n", "scene,age\nrock,-5\n", "scene,age\nrock,old\n",
        "scene,age\nrock,/etc/passwd\n", "scene,age,site\na,,A\nb,30..10,B\n", "scene;age;site\na;;A\nb;0;B\n",
        "scene,rock\na,../x\n",
    ],
    "rocks.place_incomplete": ["scene,longitude\nrock,1\n"],
    "campaign.key_unknown": ["scene,longitud\nrock,1\n", "scene,colour\nrock,red\n"],
    "file.absent": ["scene\tensemble\na\t\nb\tnowhere\n", "scene,seismograms\na,\nb,none.v2\n"],
    "rocks.records_given_twice": ["scene,ensemble,seismograms\na,own,own\n"],
    "rocks.column_repeated": ["scene,Scene\nrock,other\n"],
    "rocks.name_repeated": ["scene\nrock\nrock\n"],
    "rocks.no_scene_column": ["rock\nx\n", "scenes/rock,Echo,-118,34\n", "", "PK\0\0"],
    "rocks.empty": ["scene\n"],
}  # fmt: skip


@pytest.mark.parametrize(
    ("code", "text"), [(code, each) for code, all_of in REFUSED.items() for each in all_of]
)
def test_what_a_table_cannot_mean_is_refused_by_place(code, text, tmp_path):
    """A wrong cell by its rock and its column."""
    (tmp_path / "own").mkdir()
    (tmp_path / "rocks.csv").write_text(text)
    with refused(code, "rocks.csv"):
        read_sites(tmp_path / "rocks.csv")
    if text.startswith("scene,age,site"):
        with refused(code, "rocks.csv, rock 2: age", "30..10"):
            read_sites(tmp_path / "rocks.csv")
