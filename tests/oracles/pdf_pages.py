"""What the pages of a PDF hold, read by another library than wrote it."""

from functools import lru_cache

import numpy as np
import pypdfium2
import pypdfium2.raw as pdfium


@lru_cache(maxsize=2)  # several tests read the same report
def pages_of(content):
    document = pypdfium2.PdfDocument(content)
    try:
        return [page_of(document[i]) for i in range(len(document))]
    finally:
        document.close()


def page_of(page):
    """Text, images (H, W, 3), number of paths, picture at 72 dpi, and the right ends of all letters, of a page."""
    text = page.get_textpage()
    objects = list(page.get_objects(max_depth=9))
    found = {
        "text": text.get_text_range(),
        "images": [
            o.get_bitmap().to_numpy()[..., 2::-1].copy() for o in objects if o.type == pdfium.FPDF_PAGEOBJ_IMAGE
        ],
        "n_paths": sum(o.type == pdfium.FPDF_PAGEOBJ_PATH for o in objects),
        "picture": np.asarray(page.render(scale=1).to_pil().convert("RGB")).astype(int),
        "lowest": min((o.get_bounds()[1] for o in objects if o.type == pdfium.FPDF_PAGEOBJ_IMAGE), default=np.inf),
        "right": max((text.get_charbox(i)[2] for i in range(text.count_chars())), default=0.0) / page.get_width(),
    }
    text.close()
    page.close()
    return found


def text_of(content):
    """All text in one line, without marks of line breaks."""
    return " ".join(
        " ".join(page["text"] for page in pages_of(content)).replace("\u200b", "").replace("\x02", "").split()
    )
