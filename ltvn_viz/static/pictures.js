// What the robot sees, drawn as it comes, pixel for pixel. The method's picture has colours on the left and depth on the
// right. The style makes it as large as there is room, or a corner of the larger picture where there is one.

const PICTURE_GAP = 8;
const FEW_COLUMNS = 160; // A picture with no more is always shown larger than it is.
const waiting = new Map(); // Pictures that are being drawn, larger or not -> the newest one that came meanwhile.

// A larger picture comes after a byte 0; without one, the method's takes its place.
async function drawPictures(bytes) {
  const isLarger = new Uint8Array(bytes)[0] === 0;
  if (waiting.has(isLarger)) return waiting.set(isLarger, bytes); // A page that cannot keep up leaves pictures out.
  waiting.set(isLarger, null);
  try {
    if (bytes.byteLength > 1) await drawPicture(new Blob([isLarger ? bytes.slice(1) : bytes], { type: "image/jpeg" }), isLarger);
    if (isLarger) byId("ltvn-pictures").toggleAttribute("data-larger", bytes.byteLength > 1);
  } finally {
    const next = waiting.get(isLarger);
    waiting.delete(isLarger);
    if (next !== null) drawPictures(next);
  }
}

async function drawPicture(jpeg, isLarger) {
  const picture = await createImageBitmap(jpeg);
  const columns = isLarger ? picture.width : (picture.width - PICTURE_GAP) / 2;
  drawPart(isLarger ? "ltvn-larger" : "ltvn-colour", picture, 0, columns);
  if (!isLarger) drawPart("ltvn-depth", picture, columns + PICTURE_GAP, columns);
  picture.close();
}

function drawPart(id, picture, from, columns) {
  const canvas = byId(id);
  if (canvas.width !== columns || canvas.height !== picture.height) {
    canvas.width = columns;
    canvas.height = picture.height;
  }
  canvas.classList.toggle("ltvn-pixels", columns <= FEW_COLUMNS);
  canvas.getContext("2d").drawImage(picture, -from, 0);
}
