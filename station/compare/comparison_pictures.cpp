#include "station/compare/comparison_pictures.h"

#include <fmt/format.h>

#include <opencv2/imgproc.hpp>

#include "compare/match/overlay.h"
#include "core/file/text.h"
#include "report/html.h"

namespace etalon {

// Side by side without a choice, so that print and readers without styles see both.
const char* const comparison_style = R"css(
.viewer{border:0;margin:0;padding:0;min-width:0}
.viewer input{position:absolute;opacity:0}
.viewer label{display:inline-block;padding:2px 10px;margin:0 4px 6px 0;font-size:.85rem;
border:1px solid var(--line);border-radius:99px;cursor:pointer;color:var(--soft)}
.viewer input:checked+label{background:var(--text);color:var(--paper);border-color:var(--text)}
.viewer input:focus-visible+label{outline:2px solid var(--soft);outline-offset:2px}
.viewer .stage{display:grid;gap:6px;grid-template-columns:1fr 1fr;touch-action:manipulation;
user-select:none}
.viewer .stage>div{position:relative}.viewer .stage img{-webkit-user-drag:none}
.viewer .stage span{position:absolute;left:6px;top:6px;padding:0 7px;border-radius:3px;
background:#000a;color:#fff;font-size:.75rem}
.viewer .stage>div:nth-child(n+3){display:none}
.viewer .one:checked~.stage{grid-template-columns:1fr}
.viewer .one:checked~.stage>div{grid-area:1/1;display:block}
.viewer .m1:checked~.stage>div:nth-child(1),.viewer .m2:checked~.stage>div:nth-child(2),
.viewer .m3:checked~.stage>div:nth-child(3){z-index:2}
.viewer .turn:checked~.stage>div:nth-child(1){z-index:2;animation:turn 1.2s steps(1) infinite}
.viewer .turn:checked~.stage>div:nth-child(2){z-index:1}
.viewer .turn:checked~.stage:active>div:nth-child(1){animation:none}
@keyframes turn{0%{opacity:1}50%{opacity:0}100%{opacity:1}}
@media(prefers-reduced-motion:reduce){.viewer .turn:checked~.stage>div:nth-child(1){animation:none;
opacity:0}.viewer .turn:checked~.stage:active>div:nth-child(1){opacity:1}}
@media print{.viewer label{display:none}}
.photo{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:14px;
margin:0 0 20px;scroll-margin-top:8px}
.photo h3{margin:0 0 .2em;font-size:1.05rem}.photo h3 small{font-weight:400;color:var(--soft)}
.photo figure{border:0;padding:0;background:none;min-width:0}
.photo .pictures{display:grid;gap:12px;grid-template-columns:repeat(3,1fr);margin:10px 0}
.photo .pictures .wide{grid-column:span 2;grid-row:span 2}
@media(max-width:720px){.photo .pictures{grid-template-columns:1fr 1fr}
.photo .pictures .wide{grid-column:1/-1}}
.zoom{cursor:zoom-in;display:block}.zoom input{position:absolute;opacity:0}
.zoom input:focus-visible~*{outline:2px solid var(--soft)}
.photo figure:has(.zoom input:checked){grid-column:1/-1}.zoom:has(input:checked){cursor:zoom-out}
.tag{display:inline-block;padding:0 9px;border-radius:99px;font-size:.8rem;font-weight:600;
border:1px solid currentColor;color:var(--unsure)}.tag.ok{color:var(--good)}
.tag.no{color:var(--bad)}
ul.findings{margin:.4em 0;padding-left:1.2em}
.sheet{display:grid;gap:10px;grid-template-columns:repeat(auto-fill,minmax(150px,1fr));margin:1em 0}
.sheet a{color:inherit;text-decoration:none;background:var(--card);border:1px solid var(--line);
border-radius:6px;overflow:hidden;font-size:.82rem}.sheet a:hover{border-color:var(--soft)}
.sheet img{width:100%;height:auto;aspect-ratio:4/3;object-fit:cover;display:block}.sheet p{margin:0;padding:5px 8px}
.scale{display:flex;gap:8px;align-items:center;font-size:.8rem;color:var(--soft)}
.scale i{flex:1;height:10px;border:1px solid var(--line);
background:linear-gradient(90deg,rgb(0,145,170),#fff,rgb(205,25,30))}
)css";

namespace {

constexpr int jpeg_quality = 85;
constexpr int room_px = 24;  // around the marker

cv::Mat eight_bit(const cv::Mat& gray) {
    cv::Mat picture;
    gray.convertTo(picture, CV_8U);
    return picture;
}

// What was not rendered is the photograph, pale: in turn with the photograph only the marker
// counts.
cv::Mat rendering_picture(const PhotoFit& fit, const cv::Mat& photo) {
    cv::Mat pale = 0.4 * photo + 0.6 * 235.0;
    fit.predicted.copyTo(pale, fit.use != pixel_outside);
    return eight_bit(pale);
}

// In the report not larger than a screen: the files beside it have all pixels.
std::string element(const cv::Mat& picture, const cv::Rect& part, const std::string& alt) {
    constexpr int max_width = 1600;
    cv::Mat shown = picture(part);
    if (part.width > max_width)
        cv::resize(shown, shown, {max_width, part.height * max_width / part.width}, 0, 0,
                   cv::INTER_AREA);
    return embedded_jpeg(shown, jpeg_quality, alt);
}

std::string thumbnail(const cv::Mat& picture, const std::string& alt) {
    constexpr int width = 260;
    cv::Mat small;
    const int height = std::max(1, picture.rows * width / picture.cols);
    cv::resize(picture, small, {width, height}, 0, 0, cv::INTER_AREA);
    return embedded_jpeg(small, jpeg_quality, alt);
}

}  // namespace

cv::Rect surroundings(const cv::Mat& use, int room) {
    cv::Rect box = cv::boundingRect(use);
    box -= cv::Point(room, room);
    box += cv::Size(2 * room, 2 * room);
    return box & cv::Rect({0, 0}, use.size());
}

PhotoPictures make_pictures(const std::filesystem::path& folder, std::size_t number,
                            const std::filesystem::path& photo, const PhotoFit& calibrated,
                            const PhotoFit* refined) {
    const cv::Mat gray = calibrated.predicted + calibrated.residual;
    const cv::Mat rendering = rendering_picture(calibrated, gray);
    const cv::Mat overlay =
        red_cyan_overlay(gray, calibrated.predicted, calibrated.use, overlay_gain);
    const cv::Mat residual =
        residual_map(calibrated.residual, calibrated.use, residual_map_scale_gray);
    const PhotoFit& best = refined ? *refined : calibrated;
    const cv::Mat significance = residual_map(best.significance, best.use, significance_map_scale);

    PhotoPictures pictures;
    const std::string stem = fmt::format("{:02}-{}", number, photo.stem().string());
    const auto file = [&](const char* what, const cv::Mat& picture) {
        const std::string name = stem + "-" + what + ".png";
        write_picture(folder / name, picture);
        return name;
    };
    pictures.overlay_file = file("overlay", overlay);
    pictures.residual_file = file("residual", residual);
    pictures.significance_file = file("significance", significance);
    pictures.rendering_file = file("rendering", rendering);

    if (refined)
        pictures.edges_file = stem + "-edges.svg";

    const std::string name = photo.filename().string();
    const cv::Rect part = surroundings(calibrated.use, room_px);
    pictures.part = part;
    pictures.photo = element(eight_bit(gray), part, "photograph " + name);
    pictures.rendering = element(rendering, part, "rendering of " + name);
    pictures.overlay = element(overlay, part, "red/cyan overlay of " + name);
    pictures.residual = element(residual, part, "residual map of " + name);
    pictures.significance = element(significance, part, "significance map of " + name);
    pictures.thumbnail = thumbnail(overlay(part), "overlay of " + name);
    if (refined) {
        pictures.refined_rendering = element(rendering_picture(*refined, gray), part,
                                             "rendering at the refined pose of " + name);
        pictures.refined_residual =
            element(residual_map(refined->residual, refined->use, residual_map_scale_gray), part,
                    "residual map at the refined pose of " + name);
    }
    return pictures;
}

PhotoPictures pictures_of_photo(const CodeImage& image, const std::filesystem::path& photo) {
    const cv::Mat picture = eight_bit(gray_of(image));
    const std::string alt = "photograph " + photo.filename().string();
    PhotoPictures pictures;
    pictures.part = cv::Rect({0, 0}, picture.size());
    pictures.photo = element(picture, pictures.part, alt);
    pictures.thumbnail = thumbnail(picture, alt);
    return pictures;
}

std::string viewer_html(const std::string& id, const std::vector<NamedPicture>& pictures,
                        bool starts_in_turn) {
    std::string text = "<fieldset class=\"viewer\">";
    const auto choice = [&](const std::string& key, const std::string& css,
                            const std::string& label, bool is_checked) {
        text += fmt::format(
            "<input type=\"radio\" name=\"{0}\" id=\"{0}-{1}\" class=\"{2}\"{3}><label "
            "for=\"{0}-{1}\">{4}</label>",
            id, key, css, is_checked ? " checked" : "", escape_html(label));
    };
    choice("both", "both", "side by side", !starts_in_turn);
    choice("turn", "one turn", "in turn", starts_in_turn);
    for (std::size_t i = 0; i < pictures.size(); ++i)
        choice(std::to_string(i + 1), fmt::format("one m{}", i + 1), pictures[i].name, false);
    text += "<div class=\"stage\">";
    for (const NamedPicture& picture : pictures)
        text +=
            fmt::format("<div>{}<span>{}</span></div>", picture.html, escape_html(picture.name));
    return text + "</div></fieldset>";
}

std::string colour_scale_html(double end, const std::string& unit) {
    return fmt::format("<div class=\"scale\">−{0:.0f}<i></i>+{0:.0f} {1}</div>", end,
                       escape_html(unit));
}

}  // namespace etalon
