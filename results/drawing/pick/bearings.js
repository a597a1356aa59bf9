// Azimuths as bearings.
const turned = degrees => ((degrees % 360) + 360) % 360;

// A quadrant bearing of an azimuth, to so many decimals, or one of four winds.
export function bearingOf(azimuth, decimals = 0) {
  const bearing = turned(+(90 - azimuth).toFixed(decimals)), north = bearing < 90 || bearing > 270;
  if (bearing % 90 === 0) return "NESW"[bearing / 90];
  const away = north ? Math.min(bearing, 360 - bearing) : Math.abs(180 - bearing);
  return `${north ? "N" : "S"}${+away.toFixed(decimals)}${bearing < 180 ? "E" : "W"}`;
}
