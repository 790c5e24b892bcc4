// What the robot sees, drawn as it comes, pixel for pixel: colours on the left of each picture, depth on the right.
// The style makes it as large as there is room.

const PICTURE_GAP = 8;
const FEW_COLUMNS = 160; // A picture with no more is always shown larger than it is.
let isDrawing = false;

async function drawPictures(jpeg) {
  if (isDrawing) return; // A page that cannot keep up leaves pictures out.
  isDrawing = true;
  try {
    const picture = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    const columns = (picture.width - PICTURE_GAP) / 2;
    drawPart("ltvn-colour", picture, 0, columns);
    drawPart("ltvn-depth", picture, columns + PICTURE_GAP, columns);
    picture.close();
  } finally {
    isDrawing = false;
  }
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
