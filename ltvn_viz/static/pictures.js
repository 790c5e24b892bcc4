// What the robot sees, drawn as it comes: colours on the left of each picture, depth on the right.

const PICTURE_WIDTH = 320;
const PICTURE_HEIGHT = 240;
let isDrawing = false;

async function drawPictures(jpeg) {
  if (isDrawing) return; // A page that cannot keep up leaves pictures out.
  isDrawing = true;
  try {
    const picture = await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" }));
    drawPart("ltvn-colour", picture, 0);
    drawPart("ltvn-depth", picture, picture.width - PICTURE_WIDTH);
    picture.close();
  } finally {
    isDrawing = false;
  }
}

function drawPart(id, picture, from) {
  const size = [PICTURE_WIDTH, PICTURE_HEIGHT];
  byId(id).getContext("2d").drawImage(picture, from, 0, ...size, 0, 0, ...size);
}
