#include "apps/report/plots/picture_file.hpp"

#include <stdlib.h>

#include <optional>

#include "tests/apps/stored_run/stored_folder.hpp"
#include "tests/catch.hpp"

namespace picture_file_test {

using namespace orbid::apps;
using namespace orbid::tests;

namespace {

/// A picture of an inch by half an inch, with text.
const std::string picture =
    "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"25.4mm\" height=\"12.7mm\" viewBox=\"0 0 72 36\">"
    "<rect width=\"72\" height=\"36\" fill=\"#ffffff\"/><text x=\"4\" y=\"20\" font-size=\"8\">orbid</text></svg>";

/// PATH while it lives.
class SearchPath {
public:
    explicit SearchPath(const std::string& path) {
        if (const char* former = ::getenv("PATH")) former_ = former;
        ::setenv("PATH", path.c_str(), 1);
    }
    ~SearchPath() {
        if (former_) ::setenv("PATH", former_->c_str(), 1);
    }
    SearchPath(const SearchPath&) = delete;
    SearchPath& operator=(const SearchPath&) = delete;

private:
    std::optional<std::string> former_;
};

bool has_converter() {
    try {
        (void)picture_file(picture, PictureFormat::png, 72.0);
        return true;
    } catch (const PictureRefused&) {
        return false;
    }
}

unsigned big_endian(const std::string& bytes, std::size_t at) {
    unsigned value = 0;
    for (std::size_t k = 0; k < 4; ++k)
        value = 256 * value + static_cast<unsigned char>(bytes.at(at + k));
    return value;
}

}  // namespace

TEST_CASE("pictures become files of the size that the resolution says", "[apps][plot]") {
    CHECK(picture_file(picture, PictureFormat::svg, 300.0) == picture);
    if (!has_converter()) {
        WARN("rsvg-convert (librsvg2-bin) is not installed: PDF and PNG are not tested");
        return;
    }
    const std::string png = picture_file(picture, PictureFormat::png, 200.0);
    REQUIRE(png.substr(1, 3) == "PNG");
    // Width and height stand in the header: an inch at 200 dots per inch.
    CHECK(big_endian(png, 16) == 200);
    CHECK(big_endian(png, 20) == 100);
    const std::string pdf = picture_file(picture, PictureFormat::pdf, 300.0);
    CHECK(pdf.substr(0, 5) == "%PDF-");
    // No clock in the file.
    CHECK(picture_file(picture, PictureFormat::pdf, 300.0) == pdf);
    CHECK_THROWS_WITH(picture_file("no picture", PictureFormat::png, 72.0), ContainsSubstring("rsvg-convert ended"));
}

TEST_CASE("without its program a format is refused, naming the package", "[apps][plot]") {
    const TemporaryFolder nothing;
    const SearchPath path(nothing.path().string());
    CHECK_THROWS_WITH(picture_file(picture, PictureFormat::pdf, 300.0),
                      ContainsSubstring("PDF files are made by rsvg-convert") && ContainsSubstring("librsvg2-bin"));
    CHECK(picture_file(picture, PictureFormat::svg, 300.0) == picture);
}

TEST_CASE("orbid plot lists and writes plots", "[apps][plot][command]") {
    const TemporaryFolder folder;
    const Path run = folder.path() / "out";
    write_stored_run(run);
    const Outcome list = orbid_with({"plot", run});
    CHECK(list.code == 0);
    CHECK_THAT(list.out, ContainsSubstring("cycles") && ContainsSubstring("residuals"));
    const Outcome one = orbid_with({"plot", run, "cycles"});
    CHECK(one.code == 0);
    CHECK(one.out == (run / "plot_cycles.svg").string() + "\n");
    CHECK(std::filesystem::exists(run / "plot_cycles.svg"));
    CHECK_THAT(orbid_with({"plot", run, "cycles", "--out", "-", "--width", "180"}).out,
               ContainsSubstring("width=\"180.00mm\""));
    const auto refused = [&](const std::vector<std::string>& arguments) {
        const Outcome outcome = orbid_with(arguments);
        CHECK(outcome.code == 2);
        CHECK(outcome.out.empty());
        return outcome.error;
    };
    CHECK_THAT(refused({"plot", run, "cycle"}), ContainsSubstring("did you mean \"cycles\"?"));
    CHECK_THAT(refused({"plot", run, "cycles", "--width", "wide"}), ContainsSubstring("--width must be a number"));
    CHECK_THAT(refused({"plot", run, "cycles", "--width", "3"}), ContainsSubstring("--width must be in [41, 1000]"));
    CHECK_THAT(refused({"plot", run, "cycles", "--format", "gif"}), ContainsSubstring("gif"));
    CHECK_THAT(refused({"plot", folder.path() / "none"}), ContainsSubstring("no such folder"));
    write_text(run / "result.json", "{");
    CHECK(orbid_with({"plot", run}).code == 3);
    if (!has_converter()) return;
    std::filesystem::remove(run / "result.json");
    // The ending says the format.
    CHECK(orbid_with({"plot", run, "cycles", "--out", folder.path() / "a.pdf"}).code == 0);
    CHECK(read_whole_file(folder.path() / "a.pdf").substr(0, 5) == "%PDF-");
}

}  // namespace picture_file_test
