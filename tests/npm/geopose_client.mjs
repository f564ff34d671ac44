// Asks a GeoPose service where an image was taken, with the Open AR Cloud's own client library.
// usage: node --import ./directory_imports.mjs geopose_client.mjs URL IMAGE WIDTH HEIGHT MODEL PARAMETERS [LATITUDE LONGITUDE]
// Prints the answer, which the library has validated, as JSON; exit code 1 and what it says of the error otherwise.
import { readFileSync } from 'node:fs';
import {
  CAMERAMODEL, CameraParam, GeoPoseRequest, IMAGEFORMAT, ImageOrientation, Privacy, SENSORTYPE, Sensor, sendRequest,
} from '@oarc/gpp-access';

const [url, image, width, height, model, parameters, latitude, longitude] = process.argv.slice(2);
const camera = new CameraParam();
camera.model = CAMERAMODEL[model];
camera.modelParams = parameters.split(',').map(Number);
const now = Date.now();
const privacy = new Privacy([], [], [], []);
const request = new GeoPoseRequest('c0ffee00-0000-4000-8000-000000000001');
request.addSensor(new Sensor('camera', SENSORTYPE.camera));
request.addCameraData(IMAGEFORMAT.JPG, [Number(width), Number(height)], readFileSync(image).toString('base64'), 0,
  new ImageOrientation(false, 0), camera, now, 'camera', privacy);
if (latitude !== undefined) {
  request.addSensor(new Sensor('gnss', SENSORTYPE.geolocation));
  request.addGeoLocationData(Number(latitude), Number(longitude), 0, 10, 10, 0, 0, now, 'gnss', privacy);
}
try {
  console.log(JSON.stringify(await sendRequest(url, JSON.stringify(request))));
} catch (error) {
  console.error(error.message);
  process.exit(1);
}
