#include <hdf5.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

#include "orbits/records/series_file.hpp"
#include "orbits/records/series_stream.hpp"
#include "tests/catch.hpp"
#include "tests/orbits/records/scratch_folder.hpp"

namespace hdf5_file_test {

using namespace orbid;
using namespace orbid::orbits;
using tests::ContainsSubstring;
using tests::ScratchFolder;

namespace {

Series example(Series::Sampling sampling) {
    std::mt19937_64 bits(11);
    Series series;
    series.sampling = sampling;
    series.phase = -0.1;
    series.coordinates = {{"phi", "rad", true}, {"phi_dot", "rad/s", false}, {"Länge", "m", false}};
    for (int s = 0; s < 3; ++s) {
        Segment segment;
        segment.label = s == 0 ? "" : "run " + std::to_string(s);
        segment.values.resize(3, 200 * s);  // the first is empty
        for (Eigen::Index i = 0; i < segment.values.size(); ++i) {
            const double value = std::bit_cast<double>(bits());
            segment.values.data()[i] = std::isinf(value) ? 1.0 : value;  // nan with any payload stays
        }
        if (sampling == Series::Sampling::samples) segment.times = Eigen::VectorXd::LinSpaced(200 * s, 0.1, 1.7);
        series.segments.push_back(segment);
    }
    return series;
}

template <class A, class B>
bool same_bits(const A& a, const B& b) {
    if (a.rows() != b.rows() || a.cols() != b.cols()) return false;
    for (Eigen::Index i = 0; i < a.size(); ++i) {
        if (std::bit_cast<std::uint64_t>(a.data()[i]) != std::bit_cast<std::uint64_t>(b.data()[i])) return false;
    }
    return true;
}

/// Changes a written file through the library itself.
template <class Change>
void altered(const std::filesystem::path& file, Change change) {
    const hid_t id = H5Fopen(file.c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
    REQUIRE(id >= 0);
    change(id);
    H5Fclose(id);
}

void put_text(hid_t owner, const char* name, const std::string& value) {
    if (H5Aexists(owner, name) > 0) H5Adelete(owner, name);
    const hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, value.size());
    const hid_t space = H5Screate(H5S_SCALAR);
    const hid_t attribute = H5Acreate2(owner, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(attribute, type, value.data());
    H5Aclose(attribute);
    H5Sclose(space);
    H5Tclose(type);
}

}  // namespace

TEST_CASE("a series survives an HDF5 file bit for bit", "[orbits]") {
    const ScratchFolder folder;
    for (const auto sampling : {Series::Sampling::section, Series::Sampling::samples}) {
        const Series series = example(sampling);
        write_hdf5(folder.path("a.h5"), series);
        const Series back = read_hdf5(folder.path("a.h5"));
        CHECK(back.sampling == sampling);
        CHECK(back.phase == series.phase);
        REQUIRE(back.coordinates.size() == 3);
        for (std::size_t i = 0; i < 3; ++i) {
            CHECK(back.coordinates[i].name == series.coordinates[i].name);
            CHECK(back.coordinates[i].unit == series.coordinates[i].unit);
            CHECK(back.coordinates[i].angle == series.coordinates[i].angle);
        }
        REQUIRE(back.segments.size() == 3);
        for (std::size_t s = 0; s < 3; ++s) {
            CHECK(back.segments[s].label == series.segments[s].label);
            CHECK(same_bits(back.segments[s].values, series.segments[s].values));
            CHECK(same_bits(back.segments[s].times, series.segments[s].times));
        }
    }
}

TEST_CASE("equal series give equal bytes", "[orbits]") {
    const ScratchFolder folder;
    const Series series = example(Series::Sampling::samples);
    write_hdf5(folder.path("a.h5"), series);
    write_hdf5(folder.path("b.h5"), example(Series::Sampling::samples));
    const std::string a = ScratchFolder::bytes(folder.path("a.h5"));
    REQUIRE(a.size() > 3 * 600 * 8);
    CHECK(a == ScratchFolder::bytes(folder.path("b.h5")));

    // No object carries a time of writing.
    altered(folder.path("a.h5"), [](hid_t file) {
        for (const char* name : {"segments", "times", "segments/000001", "times/000002"}) {
            H5O_info_t info{};
            REQUIRE(H5Oget_info_by_name(file, name, &info, H5P_DEFAULT) >= 0);
            CHECK(info.mtime == 0);
            CHECK(info.ctime == 0);
        }
    });
}

TEST_CASE("what is no series is refused with file and object", "[orbits]") {
    const ScratchFolder folder;
    const auto file = folder.path("a.h5");
    const auto refused = [&](auto change, const std::string& rule) {
        CAPTURE(rule);
        write_hdf5(file, example(Series::Sampling::samples));
        altered(file, change);
        CHECK_THROWS_AS(read_hdf5(file), DataError);
        CHECK_THROWS_WITH(read_hdf5(file), ContainsSubstring("a.h5: ") && ContainsSubstring(rule));
    };
    refused([](hid_t f) { put_text(f, "format", "orbid-series/7"); },
            "attribute \"format\" is \"orbid-series/7\", only \"orbid-series/1\" can be read");
    refused([](hid_t f) { H5Adelete(f, "format"); }, "attribute \"format\" is missing");
    refused([](hid_t f) { put_text(f, "sampling", "sometimes"); }, "must be \"section\" or \"samples\"");
    refused([](hid_t f) { put_text(f, "phase", "late"); }, "attribute \"phase\" must hold numbers");
    refused([](hid_t f) { put_text(f, "units", "rad"); }, "have 3, 1 and 3 entries");
    refused([](hid_t f) { H5Ldelete(f, "segments", H5P_DEFAULT); }, "group \"segments\" is missing");
    refused([](hid_t f) { H5Ldelete(f, "segments/000001", H5P_DEFAULT); }, "dataset \"segments/000001\" is missing");
    refused([](hid_t f) { H5Ldelete(f, "times/000001", H5P_DEFAULT); }, "dataset \"times/000001\" is missing");
    refused(
        [](hid_t f) {
            H5Lmove(f, "times/000001", f, "times/000002_", H5P_DEFAULT, H5P_DEFAULT);
            H5Lmove(f, "times/000002", f, "times/000001", H5P_DEFAULT, H5P_DEFAULT);
        },
        "dataset \"times/000001\" has shape (400), must be (200)");
    refused(
        [](hid_t f) {
            H5Ldelete(f, "segments/000001", H5P_DEFAULT);
            H5Lcopy(f, "times/000001", f, "segments/000001", H5P_DEFAULT, H5P_DEFAULT);
        },
        "has shape (200), must be (points, 3)");
    refused(
        [](hid_t f) {
            const hid_t times = H5Dopen2(f, "times/000001", H5P_DEFAULT);
            const std::vector<double> falling(200, 1.0);
            H5Dwrite(times, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, falling.data());
            H5Dclose(times);
        },
        "dataset \"times/000001\", point 1: times must be finite and ascend");
    refused(
        [](hid_t f) {
            const hid_t values = H5Dopen2(f, "segments/000001", H5P_DEFAULT);
            const std::vector<double> infinite(600, std::numeric_limits<double>::infinity());
            H5Dwrite(values, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, infinite.data());
            H5Dclose(values);
        },
        "dataset \"segments/000001\", point 0: infinite value");

    CHECK_THROWS_WITH(read_hdf5(folder.path("none.h5")), ContainsSubstring("none.h5: no such file"));
    CHECK_THROWS_WITH(read_hdf5(folder.path("")), ContainsSubstring("is a folder"));
    CHECK_THROWS_WITH(read_hdf5(folder.file("t.h5", "segment,t\n0,1\n")),
                      ContainsSubstring("t.h5: is not an HDF5 file"));
    write_hdf5(file, example(Series::Sampling::section));
    CHECK_THROWS_WITH(read_hdf5(file, 601), ContainsSubstring("has 600 points, at least 601 are needed"));
}

TEST_CASE("what cannot become an HDF5 series is refused", "[orbits]") {
    const ScratchFolder folder;
    Series series = example(Series::Sampling::samples);
    CHECK_THROWS_AS(write_hdf5(folder.path("no/such/a.h5"), series), DataError);
    CHECK_THROWS_WITH(write_hdf5(folder.path("no/such/a.h5"), series),
                      ContainsSubstring("cannot be opened for writing"));
    series.segments[1].times.resize(3);
    CHECK_THROWS_AS(write_hdf5(folder.path("a.h5"), series), std::invalid_argument);
    CHECK_FALSE(std::filesystem::exists(folder.path("a.h5")));
    series = example(Series::Sampling::section);
    series.coordinates.pop_back();
    CHECK_THROWS_WITH(write_hdf5(folder.path("a.h5"), series), ContainsSubstring("3 rows of values, the series 2"));
}

/// A dataset of 200 points whose numbers are elsewhere.
void put_dataset(hid_t file, const char* path, hid_t properties) {
    const hsize_t shape[] = {200, 3};
    const hid_t space = H5Screate_simple(2, shape, nullptr);
    H5Ldelete(file, path, H5P_DEFAULT);
    H5Dclose(H5Dcreate2(file, path, H5T_IEEE_F64LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
    H5Sclose(space);
}

TEST_CASE("a file that leads to other files is refused: they are not its sender's", "[orbits]") {
    const ScratchFolder folder;
    const auto file = folder.path("a.h5"), secret = folder.path("secret.h5");
    write_hdf5(secret, example(Series::Sampling::section));
    const auto refused = [&](auto change, const std::string& message) {
        write_hdf5(file, example(Series::Sampling::section));
        altered(file, change);
        CHECK_THROWS_WITH(read_hdf5(file), ContainsSubstring("a.h5: " + message));
        const auto whole = [&] { return stream_hdf5(file)->read(0, 1000); };
        CHECK_THROWS_WITH(whole(), ContainsSubstring("a.h5: " + message));
    };
    const std::string link = "it links to another file (" + secret.string() + "); only what is in the file itself";
    refused(
        [&](hid_t f) {
            H5Ldelete(f, "segments", H5P_DEFAULT);
            H5Lcreate_external(secret.c_str(), "segments", f, "segments", H5P_DEFAULT, H5P_DEFAULT);
        },
        link);
    refused(
        [&](hid_t f) {
            H5Ldelete(f, "segments/000001", H5P_DEFAULT);
            H5Lcreate_external(secret.c_str(), "segments/000001", f, "segments/000001", H5P_DEFAULT, H5P_DEFAULT);
        },
        link);
    // By a detour within the file.
    refused(
        [&](hid_t f) {
            H5Ldelete(f, "segments/000001", H5P_DEFAULT);
            H5Lcreate_external(secret.c_str(), "segments/000001", f, "detour", H5P_DEFAULT, H5P_DEFAULT);
            H5Lcreate_soft("/detour", f, "segments/000001", H5P_DEFAULT, H5P_DEFAULT);
        },
        link);
    const std::string elsewhere = "dataset \"segments/000001\" has its numbers in other files";
    refused(
        [&](hid_t f) {
            const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
            H5Pset_external(properties, secret.c_str(), 0, 200 * 3 * sizeof(double));
            put_dataset(f, "segments/000001", properties);
            H5Pclose(properties);
        },
        elsewhere);
    refused(
        [&](hid_t f) {
            const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
            const hsize_t shape[] = {200, 3};
            const hid_t space = H5Screate_simple(2, shape, nullptr);
            H5Pset_virtual(properties, space, secret.c_str(), "segments/000001", space);
            put_dataset(f, "segments/000001", properties);
            H5Sclose(space);
            H5Pclose(properties);
        },
        elsewhere);
}

}  // namespace hdf5_file_test
