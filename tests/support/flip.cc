// SPDX-License-Identifier: Apache-2.0
#include "tests/support/flip.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numeric>

namespace kdray::test {
namespace {

constexpr double kPi = 3.14159265358979323846;

using Vec = std::array<double, 3>;
using Plane = std::vector<double>;

// ---- Colour spaces ----

Vec LinearToXyz(const Vec& c) {
  return {0.4123907993 * c[0] + 0.3575843394 * c[1] + 0.1804807884 * c[2],
          0.2126390059 * c[0] + 0.7151686788 * c[1] + 0.0721923154 * c[2],
          0.0193308187 * c[0] + 0.1191947798 * c[1] + 0.9505321522 * c[2]};
}
Vec XyzToLinear(const Vec& c) {
  return {3.2409699419 * c[0] - 1.5373831776 * c[1] - 0.4986107603 * c[2],
          -0.9692436363 * c[0] + 1.8759675015 * c[1] + 0.0415550574 * c[2],
          0.0556300797 * c[0] - 0.2039769589 * c[1] + 1.0569715142 * c[2]};
}
const Vec kWhite = LinearToXyz({1, 1, 1});

// The opponent space in which the eye's contrast sensitivity is known: achromatic, red-green,
// blue-yellow.
Vec LinearToOpponent(const Vec& c) {
  Vec xyz = LinearToXyz(c);
  for (std::size_t i = 0; i < 3; ++i) xyz[i] /= kWhite[i];
  return {116 * xyz[1] - 16, 500 * (xyz[0] - xyz[1]), 200 * (xyz[1] - xyz[2])};
}
Vec OpponentToLinear(const Vec& c) {
  const double y = (c[0] + 16) / 116;
  Vec linear =
      XyzToLinear({(y + c[1] / 500) * kWhite[0], y * kWhite[1], (y - c[2] / 200) * kWhite[2]});
  for (double& v : linear) v = std::clamp(v, 0.0, 1.0);
  return linear;
}

// CIELAB, its chroma weaker where it is dark (Hunt's effect).
Vec LinearToHuntLab(const Vec& c) {
  const auto f = [](double t) {
    constexpr double kDelta = 6.0 / 29;
    return t > kDelta * kDelta * kDelta ? std::cbrt(t) : t / (3 * kDelta * kDelta) + 4.0 / 29;
  };
  const Vec xyz = LinearToXyz(c);
  const double x = f(xyz[0] / kWhite[0]), y = f(xyz[1] / kWhite[1]), z = f(xyz[2] / kWhite[2]);
  const double lightness = 116 * y - 16;
  return {lightness, 0.01 * lightness * 500 * (x - y), 0.01 * lightness * 200 * (y - z)};
}

double HyAb(const Vec& a, const Vec& b) {
  return std::fabs(a[0] - b[0]) + std::hypot(a[1] - b[1], a[2] - b[2]);
}

// ---- Filters ----

struct Kernel {
  int radius;
  Plane weights;  // (2 radius + 1)^2, row by row
};

template <class Weight>
Kernel MakeKernel(int radius, const Weight& weight) {
  Kernel kernel{radius, {}};
  for (int y = -radius; y <= radius; ++y) {
    for (int x = -radius; x <= radius; ++x) kernel.weights.push_back(weight(x, y));
  }
  return kernel;
}

/// Positive weights that sum up to 1, negative ones that sum up to -1.
Kernel Normalized(Kernel kernel) {
  double positive = 0, negative = 0;
  for (const double w : kernel.weights) (w > 0 ? positive : negative) += w;
  for (double& w : kernel.weights) w /= w > 0 ? positive : -negative;
  return kernel;
}

/// Beyond the image is what lies at its border.
Plane Convolve(const Plane& in, int width, int height, const Kernel& kernel) {
  Plane out(in.size());
  const int r = kernel.radius;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double sum = 0;
      std::size_t k = 0;
      for (int dy = -r; dy <= r; ++dy) {
        const int row = std::clamp(y + dy, 0, height - 1) * width;
        for (int dx = -r; dx <= r; ++dx) {
          sum += kernel.weights[k++] *
                 in[static_cast<std::size_t>(row + std::clamp(x + dx, 0, width - 1))];
        }
      }
      out[static_cast<std::size_t>(y * width + x)] = sum;
    }
  }
  return out;
}

/// A sum of two Gaussians whose Fourier transform is the contrast sensitivity of one channel.
Kernel ContrastKernel(double a1, double b1, double a2, double b2, double ppd) {
  constexpr double kWidest = 0.04;  // of b1 and b2 over all channels: one radius for all
  const int radius = static_cast<int>(std::ceil(3 * std::sqrt(kWidest / (2 * kPi * kPi)) * ppd));
  return Normalized(MakeKernel(radius, [&](int x, int y) {
    const double z = (x * x + y * y) / (ppd * ppd);
    return a1 * std::sqrt(kPi / b1) * std::exp(-kPi * kPi * z / b1) +
           a2 * std::sqrt(kPi / b2) * std::exp(-kPi * kPi * z / b2);
  }));
}

// ---- The two parts of FLIP ----

std::array<Plane, 3> Opponents(const LinearImage& image) {
  std::array<Plane, 3> planes;
  for (std::size_t i = 0; i + 2 < image.rgb.size(); i += 3) {
    const Vec c = LinearToOpponent({image.rgb[i], image.rgb[i + 1], image.rgb[i + 2]});
    for (std::size_t k = 0; k < 3; ++k) planes[k].push_back(c[k]);
  }
  return planes;
}

/// What the eye makes of the colours from where it is.
std::vector<Vec> SeenColors(const std::array<Plane, 3>& opponents, int width, int height,
                            double ppd) {
  const std::array<Plane, 3> seen = {
      Convolve(opponents[0], width, height, ContrastKernel(1, 0.0047, 0, 1e-5, ppd)),
      Convolve(opponents[1], width, height, ContrastKernel(1, 0.0053, 0, 1e-5, ppd)),
      Convolve(opponents[2], width, height, ContrastKernel(34.1, 0.04, 13.5, 0.025, ppd))};
  std::vector<Vec> colors(opponents[0].size());
  for (std::size_t i = 0; i < colors.size(); ++i) {
    colors[i] = LinearToHuntLab(OpponentToLinear({seen[0][i], seen[1][i], seen[2][i]}));
  }
  return colors;
}

double ColorDifference(const Vec& a, const Vec& b) {
  constexpr double kExponent = 0.7, kShare = 0.4, kAtShare = 0.95;
  static const double largest =
      std::pow(HyAb(LinearToHuntLab({0, 1, 0}), LinearToHuntLab({0, 0, 1})), kExponent);
  const double difference = std::pow(HyAb(a, b), kExponent);
  const double knee = kShare * largest;
  if (difference < knee) return kAtShare / knee * difference;
  return kAtShare + (difference - knee) / (largest - knee) * (1 - kAtShare);
}

/// Strength of edges and of points in the achromatic channel.
struct Features {
  Plane edges, points;
};
Features FindFeatures(const Plane& achromatic, int width, int height, double ppd) {
  constexpr double kWidthDegrees = 0.082;
  const double sd = 0.5 * kWidthDegrees * ppd;
  const int radius = static_cast<int>(std::ceil(3 * sd));
  const auto gauss = [&](int x, int y) { return std::exp(-(x * x + y * y) / (2 * sd * sd)); };
  Plane y(achromatic);
  for (double& v : y) v = (v + 16) / 116;
  const auto strength = [&](const auto& weight) {
    const Plane across = Convolve(y, width, height, Normalized(MakeKernel(radius, weight)));
    const Plane down =
        Convolve(y, width, height,
                 Normalized(MakeKernel(radius, [&](int dx, int dy) { return weight(dy, dx); })));
    Plane norm(y.size());
    for (std::size_t i = 0; i < norm.size(); ++i) norm[i] = std::hypot(across[i], down[i]);
    return norm;
  };
  return {strength([&](int dx, int dy) { return -dx * gauss(dx, dy); }),
          strength([&](int dx, int dy) { return (dx * dx / (sd * sd) - 1) * gauss(dx, dy); })};
}

}  // namespace

std::vector<float> Flip(const LinearImage& a, const LinearImage& b, double pixels_per_degree) {
  assert(a.width == b.width && a.height == b.height && a.rgb.size() == b.rgb.size());
  const auto opponents_a = Opponents(a), opponents_b = Opponents(b);
  const auto colors_a = SeenColors(opponents_a, a.width, a.height, pixels_per_degree);
  const auto colors_b = SeenColors(opponents_b, a.width, a.height, pixels_per_degree);
  const Features features_a = FindFeatures(opponents_a[0], a.width, a.height, pixels_per_degree);
  const Features features_b = FindFeatures(opponents_b[0], a.width, a.height, pixels_per_degree);

  std::vector<float> flip(colors_a.size());
  for (std::size_t i = 0; i < flip.size(); ++i) {
    const double feature =
        std::sqrt(std::max(std::fabs(features_a.edges[i] - features_b.edges[i]),
                           std::fabs(features_a.points[i] - features_b.points[i])) /
                  std::sqrt(2.0));
    flip[i] = static_cast<float>(
        std::pow(ColorDifference(colors_a[i], colors_b[i]), 1 - std::min(feature, 1.0)));
  }
  return flip;
}

double MeanFlip(const LinearImage& a, const LinearImage& b, double pixels_per_degree) {
  const std::vector<float> flip = Flip(a, b, pixels_per_degree);
  if (flip.empty()) return 0;
  return std::accumulate(flip.begin(), flip.end(), 0.0) / static_cast<double>(flip.size());
}

}  // namespace kdray::test
