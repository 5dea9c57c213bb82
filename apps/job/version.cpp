#include "apps/job/version.hpp"

#include <fmt/format.h>
#include <Eigen/Core>
#include <boost/version.hpp>

#include "models/system/processor_level.hpp"

namespace orbid::apps {

std::string program_version() {
    return ORBID_VERSION;
}

Versions versions() {
    return {{"orbid", program_version()},
            {"compiler", __VERSION__},
            {"processor", models::processor_level()},
            {"Eigen", fmt::format("{}.{}.{}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION)},
            {"Boost", fmt::format("{}.{}", BOOST_VERSION / 100000, BOOST_VERSION / 100 % 1000)}};
}

}  // namespace orbid::apps
