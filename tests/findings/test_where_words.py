"""The words that say where a case was compared."""

from glossbench.findings.where_words import make_shortener, split_where


def test_commas_within_brackets_do_not_divide():
    where = (
        "spots, kurt (kd [0.8, 0.8], ks [0, 0], m [0.1, 0.1]), mesh (shape bowl), samples 16, a (b [1, 2]) against c"
    )

    assert split_where(where) == [
        "spots", "kurt (kd [0.8, 0.8], ks [0, 0], m [0.1, 0.1])", "mesh (shape bowl)", "samples 16",
        "a (b [1, 2]) against c",
    ]  # fmt: skip


def test_of_a_name_that_all_cases_share_only_the_options_are_left():
    words = [
        split_where(f"kurt (kd [{kd}, 0], m [0.1, 0.1]), {view}")
        for kd, view in ((1, "mesh (shape bowl)"), (2, "sphere"))
    ]

    shorten = make_shortener(words)

    assert [[shorten(word) for word in own] for own in words] == [
        ["kd [1, 0], m [0.1, 0.1]", "mesh with shape bowl"], ["kd [2, 0], m [0.1, 0.1]", "sphere"],
    ]  # fmt: skip
