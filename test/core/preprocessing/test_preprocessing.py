"""Preprocessing: masks of what is not the scene's, smoothing."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from warps import about_centre, corner_error, view, world

from motion_detect_ros.core.config import PipelineConfig, PreprocessingConfig
from motion_detect_ros.core.ego_motion.stage import EgoMotionStage
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.pipeline import MotionPipeline, warm_up
from motion_detect_ros.core.preprocessing.scene_mask import scene_cells
from motion_detect_ros.core.preprocessing.stage import Preprocessor, mean_shift
from motion_detect_ros.core.regions import Region, parse_regions
from motion_detect_ros.core.settings import with_settings
from motion_detect_ros.presets import load_preset

PERIOD_NS = 40_000_000


def mask_of(config: PreprocessingConfig, width: int = 640, height: int = 480) -> np.ndarray | None:
    return Preprocessor(config).process(np.zeros((height, width), np.uint8), 0).mask


class TestRegions:
    def test_text_to_rectangles(self):
        assert parse_regions('1,2,30,40; 5, 6, 7, 8;') == (Region(1, 2, 30, 40), Region(5, 6, 7, 8))
        assert parse_regions('') == parse_regions('  ') == ()

    @pytest.mark.parametrize('text', ['1,2,3', '1,2,3,4,5', '1,2,3,x', '1 2 3 4', '1.5,2,3,4', ','])
    def test_what_is_no_rectangle_is_refused(self, text):
        with pytest.raises(ConfigError, match=f'expected "x,y,w,h; x,y,w,h", whole pixels, got .{text}'):
            with_settings(PipelineConfig(), {'preprocessing.ignore_regions': text})

    @pytest.mark.parametrize('text', ['-1,0,5,5', '0,0,0,5'])
    def test_impossible_rectangles_are_refused(self, text):
        with pytest.raises(ConfigError, match='expected x, y from 0 and w, h from 1'):
            PreprocessingConfig(ignore_regions=text)

    def test_a_region_off_the_picture_is_left_out_and_told_once_for_each_size(self):
        prepare = Preprocessor(PreprocessingConfig(ignore_regions='640,0,10,10; 100,480,5,5; 600,400,100,100'))
        small, large = np.zeros((480, 640), np.uint8), np.zeros((960, 1280), np.uint8)
        told = [prepare.process(small, stamp) and prepare.complaints for stamp in (0, 1)]
        words = 'preprocessing.ignore_regions: region {} is not on the 640x480 picture, and left out'
        assert told == [(words.format('640,0,10,10'), words.format('100,480,5,5'))] * 2
        mask = prepare.process(small, 2).mask
        assert mask is not None and not mask[400:, 600:].any()
        assert np.count_nonzero(~mask) == 80 * 40
        large_mask = prepare.process(large, 3).mask
        assert large_mask is not None and not large_mask[0:7, 480:487].any()  # of 960 working pixels: all are on it
        assert prepare.complaints == told[0]

    def test_nothing_on_the_picture_is_no_mask(self):
        assert mask_of(PreprocessingConfig(ignore_regions='640,0,10,10')) is None

    def test_nothing_ignored_is_no_mask(self):
        assert mask_of(PreprocessingConfig()) is None

    def test_exactly_these_pixels(self):
        mask = mask_of(PreprocessingConfig(ignore_top_px=10, ignore_regions='100,200,30,40; 630,470,50,50'))
        expected = np.ones((480, 640), np.bool_)
        expected[:10] = expected[200:240, 100:130] = expected[470:, 630:] = False
        np.testing.assert_array_equal(mask, expected)

    def test_every_small_pixel_that_shows_any_of_it(self):
        mask = mask_of(PreprocessingConfig(max_width_px=160, ignore_regions='101,202,30,40'))  # a quarter
        expected = np.ones((120, 160), np.bool_)
        expected[50:61, 25:33] = False  # rows 200 .. 243, columns 100 .. 131
        np.testing.assert_array_equal(mask, expected)

    def test_built_once_for_a_size(self):
        prepare = Preprocessor(PreprocessingConfig(ignore_top_px=10))
        first, second = (prepare.process(np.zeros((100, 100), np.uint8), stamp).mask for stamp in (0, 1))
        other = prepare.process(np.zeros((50, 100), np.uint8), 2).mask
        assert first is second and other is not None and other.shape == (50, 100)

    def test_regions_of_real_pictures_do_not_stop_the_warm_up(self):
        warm_up(PipelineConfig(preprocessing=PreprocessingConfig(max_width_px=480, ignore_regions='1800,1000,100,50')))


class TestWorkingWidth:
    @pytest.mark.parametrize(('preset', 'least_px'), [('default', 0), ('report', 0), ('visdrone', 960), ('kitti', 960)])
    def test_presets_of_scenes_enlarge_small_pictures(self, preset: str, least_px: int) -> None:
        assert load_preset(preset).preprocessing.min_width_px == least_px

    @pytest.mark.parametrize(('width', 'settings', 'working'), [
        (640, {}, 640), (1200, {}, 960), (640, {'max_width_px': 320}, 320), (640, {'min_width_px': 960}, 960),
        (480, {'min_width_px': 960}, 960), (300, {'min_width_px': 960}, 600), (960, {'min_width_px': 960}, 960),
        (640, {'min_width_px': 700}, 700), (640, {'min_width_px': 960, 'max_width_px': 720}, 720),
        (1000, {'min_width_px': 1200, 'max_width_px': 1200}, 1200),
    ])
    def test_between_the_least_and_the_most(self, width: int, settings: dict[str, int], working: int) -> None:
        frame = Preprocessor(PreprocessingConfig(**settings)).process(np.zeros((90, width), np.uint8), 0)
        assert (frame.gray.shape[1], frame.width, frame.height) == (working, width, 90)
        assert frame.scale == working / width and frame.gray.shape[0] == round(90 * working / width)

    def test_load_lowers_that_of_small_pictures_too(self) -> None:
        prepare = Preprocessor(PreprocessingConfig(min_width_px=960))
        widths = []
        for share in (1.0, 0.75, 0.5, 1.0):
            prepare.limit_width(share)
            widths.append(prepare.process(np.zeros((90, 640), np.uint8), 0).gray.shape[1])
        assert widths == [960, 720, 480, 960]

    @pytest.mark.parametrize(('most', 'size'), [(960, (1920, 100)), (200, (1242, 375)), (100, (480, 270))])
    def test_load_lowers_no_side_below_what_can_be_worked_on(self, most: int, size: tuple[int, int]) -> None:
        prepare = Preprocessor(PreprocessingConfig(max_width_px=most, min_width_px=0))
        picture = np.zeros((size[1], size[0]), np.uint8)
        for share in (1.0, 0.75, 0.5, 0.1):
            prepare.limit_width(share)
            height, width = prepare.process(picture, 0).gray.shape
            assert min(height, width) >= 32
            assert width <= max(round(share * most), math.ceil(32 * size[0] / size[1]))
            assert width / height == pytest.approx(size[0] / size[1], rel=0.02)

    def test_everything_stays_where_it_is(self) -> None:
        """The middle of a blot at 200.3, 41.8 of a picture that is enlarged by one and a half, centres at halves."""
        x, y = np.meshgrid(np.arange(640) + 0.5, np.arange(90) + 0.5)
        blot = 200.0 * np.exp(-((x - 200.3) ** 2 + (y - 41.8) ** 2) / 50.0)
        prepare = Preprocessor(PreprocessingConfig(min_width_px=960))
        gray = prepare.process(np.rint(blot).astype(np.uint8), 0).gray.astype(float)
        x, y = np.meshgrid(np.arange(960) + 0.5, np.arange(135) + 0.5)
        assert (gray * x).sum() / gray.sum() == pytest.approx(1.5 * 200.3, abs=0.03)
        assert (gray * y).sum() / gray.sum() == pytest.approx(1.5 * 41.8, abs=0.03)


class TestCells:
    def test_only_cells_that_are_the_scene_s_whole(self):
        mask = np.ones((40, 80), np.bool_)
        mask[10, 9] = False
        expected = np.ones((10, 20), np.bool_)
        expected[2, 2] = False
        np.testing.assert_array_equal(scene_cells(mask, np.eye(3), 1.0, 10, 20), expected)

    def test_where_the_overlay_was_is_not_the_scene_s_either(self):
        mask, matrix = np.ones((40, 80), np.bool_), np.eye(3)
        mask[8:12, 8:12] = False
        matrix[0, 2] = 16.0  # full-resolution pixels: 8 of the working ones
        expected = np.ones((10, 20), np.bool_)
        expected[2, [2, 4]] = False
        np.testing.assert_array_equal(scene_cells(mask, matrix, 0.5, 10, 20), expected)


class TestMaskedScene:
    def test_a_burnt_in_block_does_not_hold_the_ego_motion(self):
        true, text = about_centre(0.5, 1.0, 5.0, -3.0), np.random.default_rng(0).integers(0, 255, (300, 640), np.uint8)
        config = PipelineConfig(preprocessing=PreprocessingConfig(ignore_regions='0,0,640,300'))
        errors = []
        for settings in (config, PipelineConfig()):
            stage, prepare = EgoMotionStage(settings), Preprocessor(settings.preprocessing)
            for index, matrix in enumerate((np.eye(3), true)):
                picture = view(world(1), matrix)
                picture[:300] = text
                ego = stage.process(prepare.process(picture, (index + 1) * PERIOD_NS))
            errors.append(corner_error(ego.matrix, true))
        assert errors[0] < 0.15
        assert errors[1] > 1.0  # without the mask the text wins

    def test_no_detection_from_inside(self):
        """A picture within the picture, in which something moves; and something that moves outside."""
        counts = []
        for regions in ('300,40,300,160', ''):
            pipeline = MotionPipeline(PipelineConfig(preprocessing=PreprocessingConfig(ignore_regions=regions)))
            inside = outside = 0
            for index in range(14):
                for box in self.boxes_after(pipeline, index):
                    within = 300 <= box['u'] < 600 and 40 <= box['v'] < 200
                    inside, outside = inside + within, outside + (not within)
            counts.append((inside, outside))
        assert counts[0][0] == 0 and counts[0][1] >= 6
        assert counts[1][0] >= 6

    @staticmethod
    def boxes_after(pipeline: MotionPipeline, index: int) -> np.ndarray:
        ground, things = world(1), world(7, 40, 40)
        picture = view(ground, about_centre(0.0, 1.0, 3.0 * index, 0.0))
        picture[40:200, 300:600] = view(world(2), np.eye(3))[40:200, 300:600]
        for left, top in ((330 + 6 * index, 100), (100 + 6 * index, 330)):
            picture[top:top + 40, left:left + 40] = things
        return pipeline.process(picture, (index + 1) * PERIOD_NS).detections


class TestMeanShift:
    def test_flat_regions_get_smooth_and_an_edge_stays(self):
        random = np.random.default_rng(0)
        clean = np.full((120, 160), 80.0)
        clean[:, 70:] = 150.0
        noisy = np.clip(clean + random.normal(0, 4, clean.shape), 0, 255).round().astype(np.uint8)
        smooth = mean_shift(noisy, 4, 12.0)
        for flat in (np.s_[10:110, 10:60], np.s_[10:110, 80:150]):
            assert smooth[flat].std() < 0.5 * noisy[flat].std()
            assert smooth[flat].mean() == pytest.approx(clean[flat].mean(), abs=0.5)
        crossing = np.argmax(smooth > 115, axis=1)
        assert np.abs(crossing - 70).max() <= 1
        step = smooth[:, 71].astype(float) - smooth[:, 68]
        assert step.min() > 50  # a blur of the same window would spread it over 9 px

    def test_off_unless_asked_for(self):
        picture = np.random.default_rng(0).integers(0, 255, (100, 100), np.uint8)
        np.testing.assert_array_equal(Preprocessor(PreprocessingConfig()).process(picture, 0).gray, picture)
        flat = np.random.default_rng(0).normal(90, 3, (100, 100)).astype(np.uint8)
        smooth = Preprocessor(PreprocessingConfig(mean_shift_px=3)).process(flat, 0).gray
        assert smooth.std() < 0.6 * flat.std()


class TestOverlay:
    BAR = np.s_[10:34, 20:220]

    @staticmethod
    def run(pictures, period_ns: int = 100_000_000) -> np.ndarray | None:
        prepare = Preprocessor(PreprocessingConfig(find_overlay=True))
        for index, picture in enumerate(pictures):
            mask = prepare.process(picture, (index + 1) * period_ns).mask
        return mask

    @staticmethod
    def noisy(picture: np.ndarray, index: int) -> np.ndarray:
        noise = np.random.default_rng(index).normal(0, 1.5, picture.shape)
        return np.clip(picture + noise, 0, 255).round().astype(np.uint8)

    @staticmethod
    def flight(index: int) -> np.ndarray:
        """(240, 320): sky without texture above moving ground, a lane line along the motion."""
        picture = world(1, 400, 900)[60:300, 6 * index:6 * index + 320].copy()
        picture[:80] = 190
        cv2.line(picture, (0, 180), (319, 180), 250, 5)
        return picture

    def with_text(self, index: int) -> np.ndarray:
        picture = self.flight(index)
        picture[self.BAR] = 20
        cv2.putText(picture, 'ALT 120 m  12:03', (24, 29), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 240, 2)
        return picture

    def test_text_on_a_moving_picture_is_found_and_nothing_else(self):
        mask = self.run(self.noisy(self.with_text(index), index) for index in range(60))
        letters = self.with_text(0)[self.BAR] > 100
        assert (~mask[self.BAR][letters]).mean() > 0.95
        elsewhere = np.ones((240, 320), np.bool_)
        elsewhere[5:39, 15:225] = False
        assert mask[elsewhere].mean() > 0.995

    def test_a_frame_is_masked_with_all_that_is_in_it(self):
        mask = self.run(self.noisy(self.with_text(index), index) for index in range(60))
        assert not mask[self.BAR].any()

    def test_an_oblique_line_along_the_motion_is_scene(self):
        """It stays the same, and so do its ends at the border of the picture."""
        def pictures():
            ground = world(1, 500, 900)
            for index in range(60):
                picture = ground[3 * index:3 * index + 240, 6 * index:6 * index + 320].copy()
                cv2.line(picture, (-20, 40), (420, 260), 250, 5)
                yield self.noisy(picture, index)
        assert self.run(pictures()) is None

    def test_it_takes_seconds_of_motion(self):
        assert self.run(self.noisy(self.with_text(index), index) for index in range(25)) is None

    def test_a_static_camera_never_masks_the_scene(self):
        """Not even with noise, and a large thing that crosses the picture."""
        def pictures():
            thing = world(5, 140, 120)
            for index in range(80):
                picture = self.with_text(0)
                crossed = picture[90:230, 3 * index:3 * index + 120]
                crossed[:] = thing[:, :crossed.shape[1]]
                yield self.noisy(picture, index)
        assert self.run(pictures()) is None

    def test_text_that_goes_is_scene_again(self):
        prepare = Preprocessor(PreprocessingConfig(find_overlay=True))
        for index in range(60):
            prepare.process(self.with_text(index), (index + 1) * 100_000_000)
        for index in range(60, 90):
            mask = prepare.process(self.flight(index), (index + 1) * 100_000_000).mask
        assert mask is None

    def test_it_is_remembered_unless_the_working_width_changes(self):
        prepare = Preprocessor(PreprocessingConfig(find_overlay=True, max_width_px=320))
        for index in range(60):
            prepare.process(self.with_text(index), (index + 1) * 100_000_000)
        prepare.limit_width(1.0)
        assert prepare.process(self.with_text(60), 6_100_000_000).mask is not None
        prepare.limit_width(0.5)
        assert prepare.process(self.with_text(61), 6_200_000_000).mask is None

    def test_reset_and_time_jumps_forget(self):
        for forget in ('reset', 'jump'):
            prepare = Preprocessor(PreprocessingConfig(find_overlay=True))
            for index in range(60):
                frame = prepare.process(self.with_text(index), (index + 1) * 100_000_000)
            assert frame.mask is not None
            if forget == 'reset':
                prepare.reset()
            assert prepare.process(self.with_text(60), 6_100_000_000 if forget == 'reset' else 1).mask is None
