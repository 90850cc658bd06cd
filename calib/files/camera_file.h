// A camera from a file and back. Our own camera.yml (`etalon: camera/1`) carries everything that
// CameraModel has; calibrations of other tools (calib/files/foreign_camera.h) are read as cameras
// without lens and sensor sections.
//
//     etalon: camera/1
//     serial: "U3V-1234"                                           # optional
//     image: {width: 640, height: 480}                             # px
//     intrinsics: {fx: 538.6, fy: 538.6, cx: 319.5, cy: 239.5}     # px
//     distortion: {k1: -0.286, k2: 0.057}           # optional; 15 names, absent ones are 0
//     covariance: {order: [fx, k1], lower: [0.04, 1e-5, 2e-6]}     # optional; by rows
//     lens:                                         # optional; needs sensor.pixel_pitch_um
//       {f_number: 2.8, focus_distance_mm: 150, wavelength_nm: 650, psf: ideal}
//     sensor: {pixel_pitch_um: 8.3, bits: 8, transfer: linear, black: 0, gain_e_per_dn: 0,
//              read_noise_e: 0, illumination: {cos4: true}}        # optional
//
// and, less common: intrinsics with skew (px, without a lens section); projection: telecentric (fx,
// fy in px/mm; the lens has object_na in place of f_number) or that of a wide lens, equidistant,
// stereographic, {field_of_view: {omega: 0.9}}, {unified: {xi: 1.2}}, {extended_unified:
// {beta: 1.1, alpha: 0.6}} or {double_sphere: {xi: -0.2, alpha: 0.6}}
// (calib/camera/lens_projection.h; without a lens section), psf: {measured: {file: psf.yml}} or
// wave, illumination: {polynomial: [c1, c2, c3]}, mosaic: RGGB, channel_response: [r, g, b]. What
// they mean: docs/files.md.
//
// f_number is the engraved one; working_f_number may stand instead, or beside it if both agree to
// 1e-6. focus_distance_mm may be the word infinity. psf: ideal or {gaussian: {sigma_px: 0.7}}.
// transfer: linear, rec709 or {table: {file: t.csv}}, a path relative to the camera file, to a CSV
// with the header `radiance,code` and both columns ascending (code in code values).
//
// What was measured may carry standard uncertainties (`etalon characterise` writes them):
//
//     standard_uncertainty: {f_number: 0.03, focus_distance_mm: 1.2, psf_sigma_px: 0.01,
//         black: 0.05, gain_e_per_dn: 0.02, read_noise_e: 0.1, illumination: [0.01, 0.02, 0.01]}
//
// each only for an entry that the file has. A psf.yml has them as `standard_uncertainty: [...]`,
// one for each density, and a transfer CSV as a third column `u_code`.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>

#include "calib/camera/camera_model.h"

namespace etalon {

// Reads ours or any other tool's, of any lens; the content tells which one it is.
//
// `image_size` is what the caller knows from elsewhere (a photo): it stands in where a foreign file
// gives no size, and must agree where the file does.
// Throws ConfigError with file, line and key for everything that cannot be a camera.
CameraModel read_any_camera(const std::filesystem::path& path,
                            std::optional<cv::Size> image_size = std::nullopt);

// The same for what takes perspective and telecentric lenses only, so far: wider ones are a
// ConfigError that names them.
CameraModel read_camera(const std::filesystem::path& path,
                        std::optional<cv::Size> image_size = std::nullopt);

// Writes camera.yml so that reading gives the same doubles; a transfer table goes into a CSV beside
// it (camera.yml -> camera.transfer.csv), a measured point spread too (camera.psf.yml). Throws
// ConfigError when a file cannot be written.
void write_camera(const std::filesystem::path& path, const CameraModel& camera);

}  // namespace etalon
