// Files of Matlab, written by other programs (matlab/README.md).
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "orbits/records/series_file.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"
#include "tests/source_folder.hpp"

namespace matlab_file_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;

namespace {

std::filesystem::path matlab_file(const std::string& name) {
    return std::filesystem::path(tests::source_folder()) / "tests/orbits/records/matlab" / name;
}

TableLayout layout_of(const std::vector<std::string>& columns) {
    TableLayout layout;
    layout.sampling = Series::Sampling::samples;
    layout.time = "t";
    for (const std::string& column : columns)
        layout.coordinates.push_back(
            {{"c" + std::to_string(layout.coordinates.size()), "", false}, column, "", 1.0, 0.0, {}});
    return layout;
}

bool same_bits(double a, double b) {
    return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

void check_row(const Series& series, Eigen::Index row, const std::vector<double>& expected) {
    const Readings& values = series.segments[0].values;
    REQUIRE(values.cols() == static_cast<Eigen::Index>(expected.size()));
    for (std::size_t k = 0; k < expected.size(); ++k) {
        const double read = values(row, static_cast<Eigen::Index>(k));
        CHECK((std::isnan(expected[k]) ? std::isnan(read) : same_bits(read, expected[k])));
    }
}

constexpr double missing = std::numeric_limits<double>::quiet_NaN();
const std::vector<double> first{1.5, 0.1, 1.0 / 3.0, std::numbers::pi, -0.0};
const std::vector<double> second{-2.0, missing, 4.0, 6.0, 8.0};
const std::vector<double> third{1e-300, 3.0, 5.0, 7.0, 9.25};

std::string refusal(const std::string& file, const TableLayout& layout) {
    try {
        (void)read_csv(matlab_file(file), layout);
    } catch (const DataError& error) {
        return error.what();
    }
    return "";
}

}  // namespace

TEST_CASE("columns of matrices come to the bit from files of Matlab of every format", "[orbits][files]") {
    for (const char* name : {"format4.mat", "format5.mat", "format7.mat", "format73.mat"}) {
        INFO(name);
        const Series series = read_csv(matlab_file(name), layout_of({"y(:,1)", "y(:,2)", "y(:,3)"}));
        REQUIRE(series.segments.size() == 1);
        CHECK(series.segments[0].times == Eigen::VectorXd{{0.0, 0.1, 0.2, 0.3, 0.4}});
        check_row(series, 0, first);
        check_row(series, 1, second);
        check_row(series, 2, third);
    }
}

TEST_CASE("rows of matrices, fields of structures and short numbers come from files of Matlab", "[orbits][files]") {
    for (const char* name : {"format5.mat", "format7.mat", "format73.mat"}) {
        INFO(name);
        const Series series = read_csv(matlab_file(name), layout_of({"rig.angle", "rig.inner.count", "y(:,1)"}));
        check_row(series, 0, {0.5, 1.5, 2.5, -3.5, static_cast<double>(0.1F)});
        check_row(series, 1, {-3.0, -1.0, 0.0, 2.0, 32767.0});
        check_row(series, 2, first);
    }
    const Series lying = read_csv(matlab_file("format5.mat"), layout_of({"lying(1,:)", "big"}));
    check_row(lying, 0, first);
    check_row(lying, 1, {255.0, 1.0, 2.0, 3.0, 4.0});
    TableLayout stepped = layout_of({"y(:,2)"});
    stepped.time.clear();
    stepped.step = 0.5;
    stepped.part.first_row = 2;
    const Series part = read_csv(matlab_file("format73.mat"), stepped);
    check_row(part, 0, {missing, 4.0, 6.0, 8.0});
    CHECK(part.segments[0].times[0] == 0.5);
}

TEST_CASE("what a file of Matlab does not have is refused with what it has", "[orbits][files]") {
    // As the file is sorted.
    const std::string all =
        "there are \"longer\", \"rig.angle\", \"rig.inner.count\", \"t\", \"y(:,1)\", \"y(:,2)\", \"y(:,3)\"";
    CHECK_THAT(refusal("format73.mat", layout_of({"rig.angel"})),
               ContainsSubstring("format73.mat: no variable \"rig.angel\" (did you mean \"rig.angle\"?); " + all));
    CHECK_THAT(refusal("format73.mat", layout_of({"y(2)"})), ContainsSubstring("no variable \"y(2)\""));
    CHECK_THAT(refusal("format73.mat", layout_of({"rig.angle.x"})), ContainsSubstring("no variable"));
    CHECK_THAT(refusal("format5.mat", layout_of({"y"})),
               ContainsSubstring("\"y\" is a matrix of 5 x 3: name one of its columns, \"y(:,1)\""));
    CHECK_THAT(refusal("format5.mat", layout_of({"y(:,4)"})),
               ContainsSubstring("there is no \"y(:,4)\": y has 5 x 3 numbers"));
    CHECK_THAT(refusal("format5.mat", layout_of({"y(:,0)"})), ContainsSubstring("there is no \"y(:,0)\""));
    CHECK_THAT(refusal("format5.mat", layout_of({"longer"})),
               ContainsSubstring("\"longer\" has 7 numbers, \"t\" has 5: columns of a table must have one length"));
    for (const char* name : {"name", "z", "rig"})
        CHECK_THAT(refusal("format5.mat", layout_of({name})),
                   ContainsSubstring("\"" + std::string(name) + "\" is no vector or matrix of real numbers"));
    CHECK_THAT(refusal("none.mat", layout_of({"y"})), ContainsSubstring("none.mat: no such file"));

    const tests::ScratchFolder folder;
    const auto text = folder.file("text.mat", "t,y\n0,1\n");
    CHECK_THROWS_AS(read_csv(text, layout_of({"y"})), DataError);
    // A file that was cut anywhere is refused or read, but never crashes.
    const std::string whole = tests::ScratchFolder::bytes(matlab_file("format5.mat"));
    for (std::size_t length = 0; length < whole.size(); length += 37) {
        const auto cut = folder.file("cut.mat", whole.substr(0, length));
        try {
            (void)read_csv(cut, layout_of({"y(:,1)"}));
        } catch (const DataError&) {
        }
    }
}

}  // namespace matlab_file_test
