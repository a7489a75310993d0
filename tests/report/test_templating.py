"""Pages from templates: any text stays a text, in the page and in the data of its scripts."""

import json
import re
from typing import Any

import pytest

from torchsphere.report.templating import page


def filled(data: Any, title: str = "") -> str:
    return page("base.html", title=title, grade="good", verdict="", data=data)


def test_any_text_comes_back_from_the_data_and_cannot_end_its_script() -> None:
    texts = ["</script><script>alert(1)</script>", "<!-- <script>", "&amp; &lt;", "{{ title }}", "'\"\\\u2028", "µ ±"]
    text = filled(texts)
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    assert json.loads(found[1]) == texts
    assert text.count("<script") == text.count("</script>") == 2


def test_a_title_stays_text() -> None:
    assert "<h1>&lt;b&gt; &amp; {{ title }}</h1>" in filled(None, "<b> & {{ title }}")


def test_data_that_json_lacks_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        filled({"values": [1.0, float("nan")]})
